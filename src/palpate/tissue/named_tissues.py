"""Tissues by name: their properties, and the elastic constants of a mesh whose regions are named tissues."""

from collections.abc import Mapping
from difflib import get_close_matches

import numpy as np

from palpate.arrays import Float64
from palpate.errors import MaterialError
from palpate.meshes.tet_mesh import TetMesh
from palpate.tissue.tissue import Constant, Tissue, constant_per_tet
from palpate.tissue.tissue_properties import QUANTITIES, TissueProperties
from palpate.tissue.tissue_table import TISSUES

ASSUMED_POISSON = 0.45  # all tissue is nearly incompressible, 0.49 and more; linear elements lock there

Named = str | Mapping[int, str] | Mapping[str, str] | Mapping[int | str, str]


def tissue_properties(name: str) -> TissueProperties:
    """Return what is known of a tissue, with sources.

    Parameters
    ----------
    name : str
        Name of the tissue: skin, fat, gland, muscle, liver, kidney, spleen, lung, vessel, bowel, breast-carcinoma,
        fibroadenoma or liver-carcinoma. A space or underscore stands for the hyphen.

    Returns
    -------
    TissueProperties
        Its quantities; what nobody measured, or what was not found, is None.

    Raises
    ------
    MaterialError
        If the name is not in the table.

    Examples
    --------
    >>> pp.tissue_properties("spleen").young.method
    'MR elastography at 60 Hz, driver on the right, 16 volunteers, human, in vivo'
    >>> pp.tissue_properties("kidney").fracture_energy is None
    True
    """
    key = "-".join(str(name).lower().replace("_", " ").replace("-", " ").split())
    if key not in TISSUES:
        meant = [n for n in TISSUES if key and key in n] or get_close_matches(key, TISSUES, 1)
        guess = f" (did you mean {' or '.join(meant)}?)" if meant else ""
        raise MaterialError(f"tissue: {name!r} is not in the table{guess}; choose one of {', '.join(TISSUES)}")
    return TISSUES[key]


def named_materials(mesh: TetMesh, tissue: Named | None) -> dict[int, str]:
    """Region number -> name of its tissue, for one name or for names by region."""
    if tissue is None:
        return {}
    if not isinstance(tissue, Mapping):
        return dict.fromkeys(_regions(mesh), tissue_properties(tissue).name)
    return {_region("tissue", mesh, key): tissue_properties(name).name for key, name in tissue.items()}


def young_of(mesh: TetMesh, young: Constant | None, materials: Mapping[int, str]) -> Constant:
    """Young's modulus, kPa: what is given, else that of the region's tissue. Raises `MaterialError` if there is none."""
    return _completed("young", mesh, young, materials)


def poisson_of(mesh: TetMesh, poisson: Constant | None, materials: Mapping[int, str]) -> Constant:
    """Poisson's ratio: what is given, else that of the region's tissue, else 0.45."""
    return _completed("poisson", mesh, poisson, materials)


def spread_of(mesh: TetMesh, young: Constant, materials: Mapping[int, str], given: Constant | None = None) -> Float64:
    """(M,) kPa, one standard deviation: what is given, else that of the table where `young` is the table's, else 0."""
    if given is not None and not isinstance(given, Mapping):
        return constant_per_tet("young_spread", given, mesh)
    modulus, spread = constant_per_tet("young", young, mesh), np.zeros(len(mesh.tets))
    for region, name in materials.items():
        known = TISSUES[name].young
        if known is not None and known.spread is not None:
            spread[(mesh.region == region) & (modulus == known.value)] = known.spread
    for key, value in (given or {}).items():
        spread[mesh.region == _region("young_spread", mesh, key)] = value
    return spread


def _completed(quantity: str, mesh: TetMesh, given: Constant | None, materials: Mapping[int, str]) -> Constant:
    if given is not None and not isinstance(given, Mapping):
        return given
    values = {_region(quantity, mesh, key): value for key, value in (given or {}).items()}
    for region in _regions(mesh):
        if region not in values:
            values[region] = _from_table(quantity, mesh, region, materials.get(region))
    return values


def _from_table(quantity: str, mesh: TetMesh, region: int, name: str | None) -> float:
    if quantity == "poisson" and (name is None or TISSUES[name].poisson is None):
        return ASSUMED_POISSON
    if name is None:
        raise MaterialError(
            f"{quantity}: region {_called(mesh, region)} has no value; give it in {QUANTITIES[quantity][1]}, or name a "
            f'tissue of the table: tissue="kidney"'
        )
    return TISSUES[name].required(quantity)


def _regions(mesh: TetMesh) -> list[int]:
    return sorted({int(r) for r in np.unique(mesh.region)})


def _called(mesh: TetMesh, region: int) -> str:
    return f"{region} ({mesh.names[region]})" if region in mesh.names else str(region)


def _region(argument: str, mesh: TetMesh, key: int | str) -> int:
    """Number of a region that is given by number or name."""
    numbers = {text: number for number, text in mesh.names.items()}
    region = numbers.get(key) if isinstance(key, str) else int(key)
    if region is None or region not in _regions(mesh):
        known = ", ".join(_called(mesh, r) for r in _regions(mesh))
        raise MaterialError(f"{argument}: the mesh has no region {key!r}; its regions are {known}")
    return region


def material_lines(tissue: Tissue) -> list[str]:
    """One line for each region with a named tissue: which constants are those of the table, and their sources."""
    lines = []
    for region, name in sorted(tissue.materials.items()):
        inside = tissue.mesh.region == region
        known = tissue_properties(name)
        parts = [f"region {_called(tissue.mesh, region)}: {name}"]
        for quantity, values in (("young", tissue.young[inside]), ("poisson", tissue.poisson[inside])):
            found = known.measured(quantity)
            ours = found is not None and bool((values == found.value).all())
            said = known.described(quantity) if ours else f"{np.median(values):g}, not from the table"
            parts.append(f"{QUANTITIES[quantity][0]} {said}")
        lines.append("; ".join(parts))
    return lines


def tissue_list() -> str:
    """The table as text, one tissue a line; * is not verified."""
    head = ["tissue", *(f"{words}{f', {unit}' if unit else ''}" for words, unit in QUANTITIES.values())]
    rows = [head]
    for known in TISSUES.values():
        cells = []
        for quantity, (_, unit) in QUANTITIES.items():
            found = known.measured(quantity)
            cells.append(
                "unknown" if found is None else found.text.removesuffix(unit).rstrip() + "*" * (not found.verified)
            )
        rows.append([known.name, *cells])
    widths = [max(len(row[k]) for row in rows) for k in range(len(head))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([*lines, "", "* not verified. Methods and sources of each number: docs/tissues.md"])
