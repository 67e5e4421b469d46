"""Names of labels that lie beside them in a JSON file: {"3": "kidney_left", ...}."""

import json
from pathlib import Path

from palpate.errors import FileError
from palpate.volumes.volume import Labels

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
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
        return {int(value): str(name) for value, name in table.items()}
    except FileNotFoundError:
        raise FileError(f"{path}: no such file; check the name (looked from {Path.cwd()})") from None
    except (OSError, ValueError, AttributeError) as problem:
        raise FileError(f'{path}: expected a JSON object such as {{"3": "kidney_left"}} ({problem})') from None
