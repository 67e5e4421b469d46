"""What a file of a tissue holds of its cuts."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.arrays import AnyArray, Float64, Int32
from palpate.errors import PalpateError
from palpate.meshes.centerline_io import stored_centerline
from palpate.meshes.cutting.blade import Blade
from palpate.meshes.cutting.cut_mesh import CutFigures, CutMesh
from palpate.meshes.cutting.skin import Skin
from palpate.meshes.import_repair import region_names

MOST = 2**27  # tetrahedra of a mesh before its cuts
PER_TET = ("share", "side", "body", "parent")
SKIN = {"skin triangles": np.int32, "skin lip": np.int32, "skin tet": np.int32, "skin weight": np.float64}


def tet_fields(mesh: CutMesh) -> dict[str, AnyArray]:
    """Values of the tetrahedra, by name."""
    return {name: getattr(mesh, name) for name in PER_TET}


def grid_fields(mesh: CutMesh) -> dict[str, AnyArray]:
    """Arrays of the surface, by name."""
    skin = mesh.skin
    return dict(zip(SKIN, (skin.triangles, skin.lip.astype(np.int32), skin.tet, skin.weight), strict=True))


def plain_blades(mesh: CutMesh) -> list[dict[str, Any]]:
    """The blades as lists of numbers."""
    return [{"points": blade.points.tolist(), "triangles": blade.triangles.tolist()} for blade in mesh.blades]


def plain_figures(mesh: CutMesh) -> dict[str, Any]:
    """What the cuts have done, by labels as text."""
    figures = mesh.figures
    by_text = ({str(label): value for label, value in each.items()} for each in (figures.areas, figures.taken))
    return dict(zip(("areas", "taken"), by_text, strict=True)) | {"regions": list(figures.regions)}


def _figures(plain: dict[str, Any], region: Int32) -> CutFigures:
    """What `plain_figures` gave, of a mesh with these regions."""
    areas, taken = ({int(k): float(v) for k, v in plain[name].items()} for name in ("areas", "taken"))
    regions = tuple(int(label) for label in plain["regions"])
    numbers = np.array([*areas.values(), *taken.values()])
    if not {*region.tolist(), *areas, *taken} <= {*regions} or not (np.isfinite(numbers) & (numbers >= 0)).all():
        raise ValueError("cuts")
    return CutFigures(areas, taken, regions)


def stored_cut_mesh(stored: Any, blades: Sequence[dict[str, Any]], figures: dict[str, Any]) -> CutMesh:
    """The mesh in what meshio read, with what `plain_blades` and `plain_figures` gave.

    Raises `ValueError`, `KeyError` or `TypeError` if it does not hold together.
    """
    nodes = np.array(stored.points, dtype=np.float64)
    tets = np.array(stored.cells[0].data, dtype=np.int32)
    share = np.array(stored.cell_data["share"][0], dtype=np.float64)
    side, body, parent, region = (_whole(stored.cell_data[name][0]) for name in (*PER_TET[1:], "region"))
    origin, real = (_whole(stored.point_data[name]) for name in ("origin", "real"))
    if not ((share > 0) & (share <= 1 + 1e-9)).all():
        raise ValueError("share")
    most = MOST if any(figures["taken"].values()) else len(share)  # what was taken away had numbers too
    for name, values, low in (("side", side, -1), ("body", body, 0), ("parent", parent, 0)):
        if values.shape != share.shape or values.min() < low or values.max() > most:
            raise ValueError(name)
    if origin.shape != (len(nodes),) or origin.min() < 0 or origin.max() >= max(len(nodes), most):
        raise ValueError("origin")
    if real.shape != origin.shape:
        raise ValueError("real")
    try:
        return CutMesh(
            nodes,
            tets,
            region,
            region_names(stored, region),
            share=share,
            side=side,
            body=body,
            origin=origin,
            real=real != 0,
            parent=parent,
            skin=_skin(stored, len(tets)),
            blades=[Blade(blade["points"], np.array(blade["triangles"])) for blade in blades],
            figures=_figures(figures, region),
            centerline=stored_centerline(stored),
        )
    except PalpateError as problem:
        raise ValueError(str(problem)) from None


def _skin(stored: Any, tets: int) -> Skin:
    triangles, lip, tet, weight = (np.array(stored.field_data[name], dtype=kind).ravel() for name, kind in SKIN.items())
    count = len(tet)
    if len(triangles) != 3 * len(lip) or len(weight) != 4 * count or not count:
        raise ValueError("skin")
    if triangles.min() < 0 or triangles.max() >= count or tet.min() < 0 or tet.max() >= tets:
        raise ValueError("skin")
    rows = np.reshape(weight, (-1, 4))
    if not np.allclose(rows.sum(axis=1), 1):
        raise ValueError("skin weight")
    return Skin(triangles.reshape(-1, 3), lip != 0, tet, rows)


def _whole(values: Any) -> Int32:
    found = np.asarray(values).ravel()
    if found.dtype.kind not in "iu":
        raise ValueError(f"{found.dtype} where whole numbers were expected")
    return found.astype(np.int32)


def text_of(values: AnyArray) -> tuple[str, str]:
    """VTK's name of the type of an array, and its numbers as text that reads back to the bit."""
    if np.asarray(values).dtype.kind == "f":
        floats: Float64 = np.asarray(values, dtype=np.float64)
        return "Float64", " ".join(map(repr, floats.ravel().tolist()))
    return "Int32", " ".join(map(str, np.asarray(values).ravel().tolist()))
