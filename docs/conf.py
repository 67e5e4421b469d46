"""Sphinx builds the site from this: `make docs`."""

import json
from pathlib import Path

from docutils.nodes import SkipNode
from latex2mathml.converter import convert

import palpate

HERE = Path(__file__).parent
project = "palpate"
author = "the palpate authors"
version = release = palpate.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinxcontrib.bibtex",
]
exclude_patterns = ["figures/README.md"]
html_theme = "furo"
html_title = "palpate"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = html_show_copyright = False
html_math_renderer = "mathml"  # browsers draw it without a script, so the site is complete offline

myst_enable_extensions = ["dollarmath", "amsmath", "substitution", "colon_fence", "deflist"]
myst_heading_anchors = 4
# Measured figures: written by `make docs-figures`, shown by name.
myst_substitutions = {
    f"{file.stem}_{name}": str(value)
    for file in sorted((HERE / "figures").glob("*.json"))
    for name, value in json.loads(file.read_text(encoding="utf-8")).items()
}

nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE.parent / "build" / "notebooks")
nb_execution_timeout = 120
nb_execution_raise_on_error = True
nb_merge_streams = True

bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "plain"

autosummary_generate = True
autosummary_ignore_module_all = False
autodoc_default_options = {"members": True}
autodoc_typehints = "none"  # the sections say shape and unit
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
default_role = "code"
nitpicky = False


def mathml(visitor, node):
    """Writes a formula as MathML."""
    block = node.tagname == "math_block"
    formula = convert(node.astext(), display="block" if block else "inline")
    if block and node["number"]:
        formula = f'<div class="math" id="{node["ids"][0]}"><span class="eqno">({node["number"]})</span>{formula}</div>'
    visitor.body.append(formula)
    raise SkipNode


def setup(app):
    """Called by Sphinx."""
    app.add_html_math_renderer("mathml", inline_renderers=(mathml, None), block_renderers=(mathml, None))
