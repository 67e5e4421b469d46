"""Wraps the paragraphs of a Markdown page (MyST), and leaves everything else as it is."""

import re

WIDTH = 120
FENCE = re.compile(r"\s*(`{3,}|~{3,}|:{3,}|\${2})")
ITEM = re.compile(r"\s*(?:[-+*]|\d{1,9}[.)])\s+")
# Headings, tables, figures, HTML, quotes, definitions, labels, rules and underlines, comments, breaks of a notebook
OTHER = re.compile(r"#{1,6}\s|\||!\[|<|>|\[[^\]]+\]:|\(\S+\)=\s*$|[-=*_]+\s*$|%|\+\+\+")
WORD = re.compile(r"(?:(`+)(?!`).*?(?<!`)\1(?!`)|\{\{.*?\}\}|\S)+")  # code and substitutions are one word
CODE = 4  # spaces that make a line code, where no paragraph is open


def wrap_markdown(page: str, width: int = WIDTH) -> str:
    """The page with each paragraph and list item that has a longer line wrapped at `width`. Only whitespace changes."""
    made: list[str] = []
    paragraph: list[str] = []
    fence = ""

    def close() -> None:
        made.extend(_filled(paragraph, width) if max(map(len, paragraph), default=0) > width else paragraph)
        paragraph.clear()

    for number, line in enumerate(page.split("\n")):
        plain = line.strip()
        opened = FENCE.match(line)
        front = number == 0 and plain == "---"  # settings of the page, up to the next such line
        if fence:
            made.append(line)
            fence = "" if _ends(fence, plain) else fence
        elif front or opened:
            close()
            made.append(line)
            fence = opened[1] if opened else "---"
            if fence == "$$" and len(plain) > 2 and plain.endswith("$$"):
                fence = ""
        elif not plain or OTHER.match(plain) or (not paragraph and _is_code(line)):
            close()
            made.append(line)
        else:
            if ITEM.match(line):
                close()
            paragraph.append(line)
    close()
    return "\n".join(made)


def _is_code(line: str) -> bool:
    """Whether a line that follows no paragraph is code by its indentation; a list within a list is none."""
    return line.startswith(CODE * " ") and not ITEM.match(line)


def _ends(fence: str, plain: str) -> bool:
    """Whether a line closes what a fence has opened."""
    if fence in ("$$", "---"):
        return plain.endswith(fence)
    return set(plain) == {fence[0]} and len(plain) >= len(fence)


def _filled(paragraph: list[str], width: int) -> list[str]:
    """The lines of a paragraph or list item, as full as they can be; as they were if one ends with a hard break."""
    if any(line.endswith(("  ", "\\")) for line in paragraph[:-1]):
        return paragraph
    item = ITEM.match(paragraph[0])
    first = item[0] if item else re.match(r"\s*", paragraph[0])[0]  # type: ignore[index]
    text = " ".join(line.strip() for line in paragraph)[len(first.lstrip()) :]
    lines: list[str] = []
    for unit in _units(text):
        if lines and len(lines[-1]) + 1 + len(unit) <= width:
            lines[-1] += f" {unit}"
        else:
            lines.append((" " * len(first) if lines else first) + unit)
    return lines


def _units(text: str) -> list[str]:
    """Words, each with those after it that may not begin a line: there they would be a list, a comment, a table."""
    units: list[str] = []
    for found in WORD.finditer(text):
        word = found[0]
        if units and any(pattern.match(f"{word} ") for pattern in (FENCE, ITEM, OTHER)):
            units[-1] += f" {word}"
        else:
            units.append(word)
    return units
