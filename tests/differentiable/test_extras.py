"""What is missing is named with its extra, and the examples of the docstrings run where their library is installed."""

import doctest
import importlib
import re
import sys
from pathlib import Path

import pytest
from support.jax_here import required_jax

from palpate.errors import ExtraError

REFERENCE = (Path(__file__).parents[2] / "docs" / "reference" / "index.md").read_text()


@pytest.mark.parametrize(
    ("module", "library", "extra"),
    [("jax", "jax", "jax"), ("torch", "torch", "torch"), ("deepinverse", "torch", "torch")],
)
def test_an_import_without_the_library_names_the_extra(monkeypatch, module, library, extra):
    monkeypatch.setitem(sys.modules, library, None)
    for name in ("jax", "torch", "deepinverse"):
        monkeypatch.delitem(sys.modules, f"palpate.differentiable.{name}", raising=False)
    with pytest.raises(ExtraError, match=rf"is not installed: pip install 'palpate\[{extra}\]'"):
        importlib.import_module(f"palpate.differentiable.{module}")


@pytest.mark.parametrize("library", [None, "jax", "torch", "deepinv"])
def test_the_examples_run(library):
    if library == "jax":
        required_jax()
    elif library:
        pytest.importorskip(library, reason=f"{library} is not installed here: make test-torch")
    file = {None: "push_response", "deepinv": "deepinverse"}.get(library, library)
    module = importlib.import_module(f"palpate.differentiable.{file}")
    (code,) = re.findall(r"^```python\n(.*?)^```", REFERENCE, re.MULTILINE | re.DOTALL)
    names = {**vars(module)}
    exec(code, names)
    runner = doctest.DocTestRunner()
    said = []
    for example in doctest.DocTestFinder().find(module, file, globs=names):
        runner.run(example, out=said.append)
    assert runner.failures == 0, "".join(said)
    assert runner.tries > 0
