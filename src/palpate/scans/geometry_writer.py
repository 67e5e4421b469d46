"""Writes views as a geometry file that `palpate scan import` reads."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from palpate.arrays import Float64
from palpate.atomic_write import replacing
from palpate.bounded_read import read_text
from palpate.scans.geometry_file import UNITS, read_geometry
from palpate.scans.views import Panel, Views

HEAD = "# Geometry file for `palpate scan import STACK --geometry THIS_FILE -o scan.h5`. Lengths are mm.\n"


def write_geometry(path: str | Path, views: Views, like: str | Path | None = None) -> None:
    """Write a geometry file that lists each view.

    Parameters
    ----------
    path : str or Path
        The YAML file to write.
    views : Views
        The geometry.
    like : str or Path, optional
        A geometry file whose other lines (values, incident, stack and so on) are kept. Without it, incident is `estimate`.

    Raises
    ------
    FileError
        If a file cannot be read or written.
    GeometryError
        If `like` is no geometry file.

    Examples
    --------
    >>> pp.write_geometry("geometry.yaml", views)
    >>> again = pp.read_geometry("geometry.yaml").views
    >>> bool(np.allclose(again.source, views.source))
    True
    """
    top: dict[str, Any] = {"values": "photons", "incident": "estimate"}
    if like is not None:
        read_geometry(like)  # refuses by name what is wrong
        top = yaml.safe_load(read_text(Path(like)))
        length = UNITS[top.get("units", "mm")]
        for key in ("gap", "thickness"):
            if key in (top.get("beam") or {}):
                top["beam"][key] = float(top["beam"][key]) * length
        for key, value in (top.get("blur") or {}).items():
            top["blur"][key] = (np.array(value, np.float64) * length).tolist()
    first = views.panels[0]
    top["units"] = "mm"
    top["panel"] = {"shape": list(first.shape), "pitch": list(first.pitch)}
    still = all(_pose(p) == _pose(first) for p in views.panels)
    if still:
        top["panel"] |= _pose(first)
    top["views"] = [
        ({"direction": _numbers(-s / np.linalg.norm(s))} if far else {"source": _numbers(s)})
        | ({} if still else {"panel": _pose(p)})
        for s, p, far in zip(views.source, views.panels, views.parallel, strict=True)
    ]
    with replacing(path) as temporary:
        temporary.write_text(HEAD + yaml.safe_dump(top, sort_keys=False, width=120), encoding="utf-8")


def _pose(panel: Panel) -> dict[str, list[float]]:
    return {
        "origin": _numbers(panel.origin),
        "row_axis": _numbers(panel.row_axis),
        "column_axis": _numbers(panel.column_axis),
    }


def _numbers(values: Float64) -> list[float]:
    return [float(v) for v in values]
