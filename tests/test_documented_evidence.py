"""docs/status.md is short, and each of its lines has evidence that names tests that exist and types no figure."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs" / "evidence").glob("*.md"))
STATUS = (ROOT / "docs" / "status.md").read_text()
EVIDENCE = {page.name: page.read_text() for page in PAGES}


def test_each_promise_is_one_line_with_its_state():
    assert max(map(len, STATUS.splitlines())) <= 200
    lines = re.findall(r"^- (.*)$", STATUS, re.MULTILINE)
    assert len(lines) > 100
    for line in lines:
        assert re.search(r": (met|partly|not met|by eye)\.$", line), line


def test_each_promise_stands_on_its_sections_page_of_evidence():
    for section in STATUS.split("\n## ")[1:]:
        (page,) = re.findall(r"\[Evidence\]\(evidence/([\w-]+\.md)\)", section)
        promises = [line.rsplit(": ", 1)[0] for line in re.findall(r"^- (.*)$", section, re.MULTILINE)]
        assert promises == re.findall(r"^## (.*)$", EVIDENCE[page], re.MULTILINE), page


def test_every_test_that_the_evidence_names_exists():
    text = "\n".join(EVIDENCE.values())
    named = re.findall(r"`(?:tests/)?((?:\w+/)?test_\w+)\.py::(\w+)`", text)
    assert len(named) > 200
    for module in sorted({module for module, _ in named}):
        tree = ast.parse((ROOT / "tests" / f"{module}.py").read_text())
        there = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
        assert not [name for of, name in named if of == module and name not in there], module
    assert text.count("::") == len(named), "a name that is not in the form `folder/test_file.py::test_name`"


def test_every_file_and_benchmark_that_the_evidence_names_exists():
    text = "\n".join(EVIDENCE.values())
    files = re.findall(r"`(?:tests/)?([\w/]*test_\w+\.py)(?:::\w+)?`", text)
    files = [f"tests/{file}" for file in files]
    files += [f"benchmarks/{part}.py" for part in re.findall(r"`python -m benchmarks[. ](\w+)", text)]
    files += [f"benchmarks/{part}.py" for part in re.findall(r"`make bench PARTS=(\w+)`", text)]
    assert len(files) > 200
    assert not [file for file in files if not (ROOT / file).is_file()]


def figures(page):
    """Numbers in the prose of a page with the words around them; names such as W2, M-MAP-3 and AVX-512 are none."""
    prose = re.sub(r"^```[\s\S]*?^```$|^#.*$", "", page, flags=re.MULTILINE)
    prose = re.sub(r"`[^`]*`|\[[^]]*\]\([^)]*\)", "", prose)
    return [" ".join(found.split()) for found in re.findall(r"[^.\n]{0,30}(?<!\w)(?<!\w-)\d.{0,30}", prose)]


@pytest.mark.parametrize(
    "text",
    ["Seen: circular 0.10 %.", "Took 147 s", "at most 4.5e-10", "594 loops", "(1e-6 mm)", "-0.3", "5-10 ms", "−1 %"],
)
def test_a_typed_figure_is_found(text):
    assert figures(f"# A page\n\n## Within 0.5 %\n\n- `test_a.py::test_b`\n\n{text}\n")


def test_names_headings_commands_and_links_are_no_figures():
    prose = "W2, M-MAP-3 and P1 with AVX-512: `palpate study --seed 5`, [3 % of it](../page.md#in-4-s).\n"
    assert not figures(f"# A page\n\n## Within 0.5 %\n\n{prose}\n```sh\nmake bench N=100\n```\n")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_no_figure_is_typed_into_the_evidence(page):
    assert not figures(page.read_text()), "link to a study or to performance.md instead, which a command writes"
