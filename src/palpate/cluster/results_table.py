"""The table of an archive's results: a row a run."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from palpate.atomic_write import replacing, writable
from palpate.cluster.command_run import CommandRun, RunRecord
from palpate.errors import DataError, ExtraError

FIRST = ("input", "output", "state", "reason", "seconds", "worker", "notes")


def check_table(path: str | Path) -> Path:
    """The path, once it is sure that a table can be written there. Raises `DataError`, `FileError`, `ExtraError`."""
    path = writable(path)
    if path.suffix not in (".csv", ".parquet"):
        raise DataError(f"{path}: a table of results is .csv or .parquet")
    if path.suffix == ".parquet":
        try:
            import pyarrow  # noqa: F401
        except ImportError:
            raise ExtraError(f"{path}: Parquet needs pyarrow, which is not installed: pip install pyarrow") from None
    return path


def write_results(path: str | Path, runs: Sequence[CommandRun], records: Sequence[RunRecord]) -> None:
    """Write what became of the runs of an archive as a table.

    A row a run: input, output, state (done, kept, failed), reason, seconds, worker, notes, then the figures that the command
    reports, such as the deviance of a reconstruction.

    Parameters
    ----------
    path : str or Path
        A .csv or .parquet.
    runs : sequence of CommandRun
        What was done.
    records : sequence of RunRecord
        What `run_archive` returned for them.

    Raises
    ------
    DataError
        If the suffix is another, or there are not as many records as runs.
    FileError
        If it cannot be written.
    ExtraError
        If pyarrow is missing for a .parquet.

    Examples
    --------
    >>> pp.write_results("results.csv", [], [])
    """
    path = check_table(path)
    if len(runs) != len(records):
        raise DataError(f"records: {len(records)} for {len(runs)} runs")
    rows: list[dict[str, Any]] = []
    for run, record in zip(runs, records, strict=True):
        row = {"input": str(run.input), "output": str(run.output), **vars(record), "notes": "; ".join(record.notes)}
        rows.append({name: row[name] for name in FIRST} | record.report)
    names = list(dict.fromkeys([*FIRST, *(name for row in rows for name in row)]))
    with replacing(path) as temporary:
        if path.suffix == ".csv":
            with temporary.open("w", newline="", encoding="utf-8") as file:
                table = csv.DictWriter(file, names, restval="")
                table.writeheader()
                table.writerows(rows)
        else:
            import pyarrow
            import pyarrow.parquet

            columns = {name: [row.get(name) for row in rows] for name in names}
            pyarrow.parquet.write_table(pyarrow.table(columns), temporary)
