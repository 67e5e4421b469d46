"""Writes docs/figures/benchmarks.json from the tables of `make bench`: `make docs-figures`.

Each number of a Markdown table in benchmarks/results/ gets a name, section_row_column. Pages show it by that name, as
{{ benchmarks_iteration_one_iteration_on_w1_wall_s_ours }}, so that no page holds a typed figure.
"""

import json
import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
RESULTS = HERE.parent / "benchmarks" / "results"


def slug(*words: str) -> str:
    """Lower-case words joined by underscores."""
    return re.sub(r"[^a-z0-9]+", "_", " ".join(words).lower()).strip("_")


def is_number(cell: str) -> bool:
    """Whether a cell holds a number."""
    return bool(re.fullmatch(r"[-+]?[\d.]+(e[-+]?\d+)?", cell))


def figures(text: str) -> dict[str, str]:
    """Every number in the tables of a page, by section, row and column."""
    found: dict[str, str] = {}
    section, head = "", []
    for line in text.splitlines():
        if line.startswith("#"):
            section = line.lstrip("# ")
        if not line.startswith("|"):
            head = []
            continue
        if not head:
            head = [cell.strip() for cell in line.strip()[1:-1].split("|")]
        elif not set(line) <= set("|- :"):
            cells = [cell.strip() for cell in line.strip()[1:-1].split("|")]
            row = [cell for cell in cells if not is_number(cell)]
            for column, cell in zip(head, cells, strict=False):
                if is_number(cell):
                    found.setdefault(slug(section, *row, column), cell)
    found["machine"] = text.splitlines()[0].lstrip("# ")
    return found


def main() -> None:
    """Takes the results of the given machine, by default those with AVX-512."""
    name = sys.argv[1] if len(sys.argv) > 1 else "amd-epyc-2-cpus-x86-64-v4-avx-512"
    found = figures((RESULTS / f"{name}.md").read_text(encoding="utf-8"))
    file = HERE / "figures" / "benchmarks.json"
    file.parent.mkdir(exist_ok=True)
    file.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"{len(found)} figures in {file.relative_to(HERE.parent)}")


if __name__ == "__main__":
    main()
