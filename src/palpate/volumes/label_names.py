"""Names of labels in a JSON file beside the labels: {"3": "kidney_left", ...}."""

from pathlib import Path

from palpate.bounded_read import parse_json, read_text
from palpate.errors import FileError
from palpate.volumes.volume import Labels

LONGEST = 1000  # characters of a name
BESIDE = "label_names.json"


def with_names(labels: Labels, path: str | Path, names: str | Path | None = None) -> Labels:
    """`labels`, read from `path`, with the names in the JSON file `names`; None looks for label_names.json beside it.

    Names that the label file itself carries stay where the JSON file says nothing. Raises `FileError`.
    """
    beside = Path(path).parent / BESIDE
    if names is None and not beside.exists():
        return labels
    return Labels(labels.values, labels.grid, {**labels.names, **read_names(names or beside)})


def read_names(path: str | Path) -> dict[int, str]:
    """Label value to name from a JSON object. Raises `FileError`."""
    path = Path(path)
    words = read_text(path)
    try:
        table = {int(value): name for value, name in parse_json(words).items()}
        if wrong := [
            value
            for value, name in table.items()
            if not (isinstance(name, str) and len(name) <= 1000 and abs(value) < 2**31)
        ]:
            raise ValueError(f"{wrong[0]}: {str(table[wrong[0]])[:60]!r}")
        return table
    except (ValueError, AttributeError) as problem:
        raise FileError(
            f'{path}: expected a JSON object such as {{"3": "kidney_left"}} ({str(problem)[:200]})'
        ) from None
