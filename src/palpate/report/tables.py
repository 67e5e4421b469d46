"""Tables of a study: a row a run, one CSV file a table."""

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.atomic_write import replacing

Row = dict[str, Any]


def write_tables(folder: Path, tables: Mapping[str, Sequence[Row]]) -> None:
    """One CSV file a table. Raises `FileError`."""
    for name, rows in tables.items():
        write_table(folder / f"{name}.csv", rows)


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """One CSV file; its columns are those of all rows. Raises `FileError`."""
    heads = list(dict.fromkeys(head for row in rows for head in row))
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, heads)
        writer.writeheader()
        writer.writerows(rows)


def where(rows: Iterable[Row], **wanted: object) -> list[Row]:
    """The rows that have these values."""
    return [row for row in rows if all(row.get(name) == value for name, value in wanted.items())]


def distinct(rows: Iterable[Row], column: str) -> list[Any]:
    """The values of a column, each once, in order."""
    return list(dict.fromkeys(row[column] for row in rows))


def shown(rows: Iterable[Row], *columns: tuple[str, str | Callable[[Row], object]]) -> list[list[object]]:
    """A table for the reader. columns: heading, and what stands below it, a format of the row's fields or a function."""
    body = [[cell.format_map(row) if isinstance(cell, str) else cell(row) for _, cell in columns] for row in rows]
    return [[heading for heading, _ in columns], *body]
