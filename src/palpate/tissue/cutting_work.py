"""The work of a blade: what new surface costs, what rubs on its flanks, and what the strained tissue gives."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from palpate.errors import MaterialError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.tissue.named_tissues import tissue_properties
from palpate.tissue.tissue import Tissue

MJ = 1e-3  # of 1 J/m² on 1 mm²


@dataclass(frozen=True)
class CuttingWork:
    """The work of a blade in one cut.

    The blade makes new surface and rubs on it. What the tools had strained before, the tissue gives back as it opens; that
    makes the blade's work less, but never less than nothing: what it does not need is lost.

    Parameters
    ----------
    area : float
        Of the cut, mm²: that of one of its two lips.
    fracture : float
        Energy that the new surface takes, mJ.
    friction : float
        Work against the friction on the blade's flanks, mJ.
    released : float, optional
        Elastic energy that the tissue loses while the tools hold still, mJ.
    unknown : tuple of str, optional
        Tissues and regions that were cut and whose toughness nobody has said: they count as 0.

    References
    ----------
    T. Azar & V. Hayward, ISBMS 2008, LNCS 5104, 166: the energies that a tool which breaks tissue exchanges with it.

    Examples
    --------
    >>> work = pp.CuttingWork(area=100, fracture=16.5, friction=2, released=6.5)
    >>> work.total
    12.0
    """

    area: float
    fracture: float
    friction: float
    released: float = 0.0
    unknown: tuple[str, ...] = ()

    @property
    def total(self) -> float:
        """Work that the hand on the blade does, mJ."""
        return max(self.fracture - self.released, 0.0) + self.friction


def cutting_work(
    before: Tissue,
    after: Tissue,
    toughness: float | Mapping[int | str, float] | None = None,
    friction: float = 0.0,
    released: float = 0.0,
) -> CuttingWork:
    """Return the work of the blade that makes one tissue of another.

    Parameters
    ----------
    before, after : Tissue
        The tissue before the cut, and after it.
    toughness : float or dict, optional
        Energy for each area of the cut, J/m²: one number, or by region number or name. The default, also of a region that
        is not named here, is the value of `tissue_properties`, or the lowest of its range, for the tissues that `fit` was
        given by name.
    friction : float, optional
        Force on each mm of the blade's edge in the tissue, N/mm, as a second pass through a cut measures it.
    released : float, optional
        Elastic energy that the tissue loses by the cut while the tools hold still, mJ.

    Returns
    -------
    CuttingWork
        The work.

    Raises
    ------
    MaterialError
        If a toughness or the friction is negative or not finite, or of a region that is not there.

    Examples
    --------
    >>> opened = pp.cut(tissue, pp.incision(tissue, [top - (8, 0, 0), top + (8, 0, 0)], depth=10))
    >>> work = pp.cutting_work(tissue, opened, toughness=164)
    >>> bool(np.isclose(work.fracture, 0.164 * work.area))
    True
    """
    tough, unknown = toughness_by_region(before, toughness)
    if not (np.isfinite(friction) and friction >= 0):
        raise MaterialError(f"friction: {friction:g} N/mm of a blade, expected 0 or more")
    new, old = (dict(one.mesh.figures.areas) if isinstance(one.mesh, CutMesh) else {} for one in (after, before))
    for region, area in old.items():
        new[region] = new.get(region, 0.0) - area
    area = sum(new.values())
    fracture = MJ * sum(tough[region] * part for region, part in new.items())
    met = tuple(name for region, name in unknown.items() if new.get(region, 0.0) > 1e-9)
    return CuttingWork(area, fracture, friction * area, released, met)


def together(first: CuttingWork, more: CuttingWork) -> CuttingWork:
    """The work of a cut that was made in two parts. Energy that the first part did not need is lost to the second."""
    unused = max(first.released - first.fracture, 0.0) + max(more.released - more.fracture, 0.0)
    return CuttingWork(
        first.area + more.area,
        first.fracture + more.fracture,
        first.friction + more.friction,
        first.released + more.released - unused,
        tuple(dict.fromkeys((*first.unknown, *more.unknown))),
    )


def toughness_by_region(
    tissue: Tissue, given: float | Mapping[int | str, float] | None
) -> tuple[dict[int, float], dict[int, str]]:
    """Toughness of each region, J/m², and the names of those whose toughness is unknown, which have 0."""
    mesh = tissue.mesh
    there = np.unique(mesh.region).tolist()
    regions = sorted(mesh.figures.regions) if isinstance(mesh, CutMesh) else there  # of what was taken away, too
    numbers = {name: region for region, name in (mesh.names or {}).items()}
    measured = {region: tissue_properties(name).fracture_energy for region, name in tissue.materials.items()}
    found = {r: float(m.value if m.value is not None else m.low or 0.0) for r, m in measured.items() if m}
    if isinstance(given, Mapping):
        strange = [key for key in given if key not in numbers and key not in regions]
        if strange:
            raise MaterialError(f"toughness: no region {strange[0]!r}; there are {[*regions, *numbers]}")
        found |= {numbers.get(str(key), key if isinstance(key, int) else -1): value for key, value in given.items()}
    elif given is not None:
        found = dict.fromkeys(regions, given)
    for value in found.values():
        if not (np.isfinite(value) and value >= 0):
            raise MaterialError(f"toughness: {value:g} J/m², expected 0 or more")
    unknown = {
        r: tissue.materials.get(r) or (mesh.names or {}).get(r) or f"region {r}" for r in regions if r not in found
    }
    return {region: found.get(region, 0.0) for region in regions}, unknown
