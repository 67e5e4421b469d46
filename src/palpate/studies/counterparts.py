"""Which figure and table of a chapter has its counterpart where in a study's report."""

from collections.abc import Sequence

from palpate.report.html_report import Section

Counterpart = tuple[str, str, str, str]  # number where it is known, what it shows, the section here, and where in it


def list_counterparts(sections: Sequence[Section], counterparts: Sequence[Counterpart], text: Sequence[str]) -> Section:
    """The list; raises `KeyError` where a section it names is missing, `ValueError` where that lacks what it names."""
    titles = {section.title: section for section in sections}
    for _, _, title, where in counterparts:
        section = titles[title]
        if not (section.table if where == "table" else len(section.pictures) >= int(where.split()[1])):
            raise ValueError(f"{title}: has no {where}")
    heads = ["of the chapter", "shows", "section here", "there"]
    return Section("Figures and tables of the chapter", text, [heads, *counterparts])
