"""docs/figures/ holds what `make docs-figures` makes of the tables of `make bench`."""

import importlib.util
import json
from pathlib import Path

ROOT = Path(__file__).parents[1]
SPEC = importlib.util.spec_from_file_location("docs_figures", ROOT / "docs" / "figures.py")
docs_figures = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(docs_figures)


def test_numbers_of_a_table_are_named_by_section_row_and_column():
    text = "# A machine\n\n## Projector\n\n| scan | way | ours s | RTK s |\n|---|---|---|---|\n| W1 | back | 0.5 | 1e-2 |\n"
    assert docs_figures.figures(text) == {
        "projector_w1_back_ours_s": "0.5",
        "projector_w1_back_rtk_s": "1e-2",
        "machine": "A machine",
    }


def test_the_figures_of_the_site_are_those_of_the_tables():
    kept = json.loads((ROOT / "docs" / "figures" / "benchmarks.json").read_text())
    tables = ROOT / "benchmarks" / "results" / "amd-epyc-2-cpus-x86-64-v4-avx-512.md"
    assert kept == docs_figures.figures(tables.read_text())
