"""The centre line of a lumen as fields of a .vtu file that belong to the whole grid."""

from typing import Any

import numpy as np

from palpate.errors import MeshError
from palpate.volumes.centerline import Centerline

LINE, OPENINGS = (
    "centerline",
    "lumen openings",
)  # rows of x, y, z, radius (mm), branch; rows of a point (mm) and a vector
COLUMNS = {LINE: 5, OPENINGS: 6}


def centerline_fields(line: Centerline | None) -> dict[str, tuple[str, str]]:
    """Type and numbers of each field."""
    if line is None:
        return {}
    rows = {LINE: np.column_stack([line.points, line.radius, line.branch]), OPENINGS: line.openings}
    return {
        name: ("Float64", " ".join(f"{x:.9g}" for x in values.ravel())) for name, values in rows.items() if len(values)
    }


def stored_centerline(stored: Any) -> Centerline | None:
    """The centre line in what meshio read. Raises `MeshError` if it is damaged."""
    if LINE not in stored.field_data:
        return None
    rows = {}
    for name, columns in COLUMNS.items():
        values = np.asarray(stored.field_data.get(name, ()), dtype=np.float64).ravel()
        if len(values) % columns or not np.isfinite(values).all():
            raise MeshError(
                f"its field {name!r} is damaged: {len(values)} numbers, expected rows of {columns} finite ones"
            )
        rows[name] = values.reshape(-1, columns)
    line = rows[LINE]
    return Centerline(line[:, :3], line[:, 3], line[:, 4].astype(np.int32), rows[OPENINGS])
