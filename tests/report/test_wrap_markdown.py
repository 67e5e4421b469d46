"""Paragraphs of a page are wrapped; tables, code, figures and the structure of lists stay."""

import io
import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from markdown_it import MarkdownIt
from PIL import Image

from palpate.report.html_report import Section
from palpate.report.publish import publish
from palpate.report.wrap_markdown import wrap_markdown

DOCS = Path(__file__).parents[2] / "docs"
RENDER = MarkdownIt("commonmark").enable("table").render  # rich's, so it is always there
STUDIES = ("deformation", "head", "realtime", "tomosynthesis")
LONG = "Springs are judged by finite elements, which share nothing with them but the mesh and the place of a push. " * 4
TABLE = "| a claim | " + "what was found here, in many words " * 8 + "|"


def test_a_long_paragraph_is_wrapped_and_reads_the_same():
    lines = wrap_markdown(LONG.strip()).split("\n")
    assert " ".join(lines) == LONG.strip()
    assert max(map(len, lines)) <= 120
    # as full as can be
    assert all(len(line) + 1 + len(after.split()[0]) > 120 for line, after in itertools.pairwise(lines))


@pytest.mark.parametrize(
    "kept",
    [
        TABLE,
        f"![{LONG}](images/a.png)",
        f"```\n{LONG}\n\n    {LONG}\n```",
        f"~~~~ text\n~~~\n{LONG}\n~~~~",
        f":::{{note}}\n{LONG}\n:::",
        f"$$\n{LONG}\n$$",
        f"---\ntitle: {LONG}\n---",
        f"    {LONG}",
        f"# {LONG}",
        f"> {LONG}",
        f"<p>{LONG}</p>",
        f"[name]: https://example.org {LONG}",
        f"% {LONG}",
        f"{LONG}\\\n{LONG}",
        "short lines\nof a paragraph   with spaces\nthat somebody broke",
    ],
)
def test_what_is_no_long_paragraph_stays(kept):
    assert wrap_markdown(kept) == kept
    assert wrap_markdown(f"# A\n\n{kept}\n\nb") == f"# A\n\n{kept}\n\nb" or kept.startswith("---")


def test_items_of_lists_stay_items_with_what_belongs_to_them():
    page = f"- {LONG}\n- short\n  - {LONG}\n    {LONG}\n\n12. {LONG}"
    lines = wrap_markdown(page).split("\n")
    assert [line[:5] for line in lines if re.match(r"\s*(-|\d+\.) ", line)] == ["- Spr", "- sho", "  - S", "12. S"]
    indents = [len(line) - len(line.lstrip()) for line in lines if line and not re.match(r"\s*(-|\d+\.) ", line)]
    assert set(indents) == {2, 4}
    assert indents == sorted(indents)
    assert max(map(len, lines)) <= 120
    assert " ".join("\n".join(lines).split()) == " ".join(page.split())
    assert RENDER("\n".join(lines)).split() == RENDER(page).split()


@pytest.mark.parametrize(
    "word", ["-", "+", "*", "7.", "12)", "#", "> 5", "| a", "%", "---", "===", "<b>", "$$", "```", "![a](b)"]
)
def test_no_line_begins_with_what_would_be_another_block(word):
    for more in range(60):
        text = f"{'x' * more} " + f"{'word ' * 9}{word} " * 9
        lines = wrap_markdown(text.strip()).split("\n")
        assert len(lines) > 2
        assert not any(line.startswith(word) for line in lines)
        assert " ".join(" ".join(lines).split()) == " ".join(text.split())
        assert RENDER("\n".join(lines)).split() == RENDER(text.strip()).split()


def test_code_and_substitutions_within_a_paragraph_are_not_broken():
    for more in range(20):
        text = f"{'x' * more} " + "see `palpate study head --docs docs`, ``a ` b c`` and {{ a figure }} " * 6
        page = wrap_markdown(text.strip())
        assert page.count("`palpate study head --docs docs`,") == page.count("``a ` b c``") == 6
        assert page.count("{{ a figure }}") == 6


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda page: page.stem)
def test_pages_keep_all_but_whitespace_and_a_second_time_changes_nothing(page):
    text = page.read_text()
    once = wrap_markdown(text)
    assert once.split() == text.split()
    assert RENDER(once).split() == RENDER(text).split()
    assert wrap_markdown(once) == once
    others = [[line for line in some.split("\n") if re.match(r"\||!\[|#|```", line)] for some in (text, once)]
    assert others[0] == others[1]


@pytest.mark.parametrize("name", STUDIES)
def test_the_pages_of_the_studies_are_wrapped(name):
    text = (DOCS / f"{name}.md").read_text()
    assert wrap_markdown(text) == text


def png(pixels):
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, format="PNG")
    return file.getvalue()


def test_a_published_page_is_wrapped(tmp_path):
    picture = np.zeros((4, 4, 3), np.uint8)
    (tmp_path / "study" / "figures").mkdir(parents=True)
    sections = [
        Section("Conclusions", text=[LONG, "short"]),
        Section("Claims", text=[LONG, "short"], table=[["a", "b"], [LONG, 1]], pictures=[(png(picture), f"{LONG}.")]),
    ]
    publish(tmp_path / "study", "head", "A head", "palpate study head", sections, tmp_path / "docs")
    lines = (tmp_path / "docs" / "head.md").read_text().split("\n")
    long = [line for line in lines if len(line) > 120]
    assert [line[:2] for line in long] == ["| ", "!["]
    assert sum(line.startswith("- ") for line in lines) == 2
    text = " ".join(" ".join(lines).split())
    assert text.count(LONG.strip()) == 5  # an item, a paragraph, a cell, a picture and its caption
    assert LONG.strip() in (tmp_path / "study" / "report.html").read_text()
