"""Monte Carlo of X-rays in tissue: images of simple bodies, and kernels of slabs.

Compton scattering with the incoherent scattering function, Rayleigh scattering with form factors, photoelectric
absorption; electrons and fluorescence stay where they are. It makes and judges the table of the estimate.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate import _core
from palpate.arrays import ArrayLike, Float64
from palpate.errors import DataError
from palpate.scans.scatter.cross_sections import attenuation, elements, monte_carlo_tables

EVERYWHERE = 1e6  # mm


@dataclass(frozen=True)
class AntiscatterGrid:
    """Parallel septa: their height, their thickness and the gap between them, mm, and the two materials."""

    height: float
    septum: float
    interspace: float
    septum_material: str = "lead"
    interspace_material: str = "polystyrene"

    def transmission(self, keV: ArrayLike) -> Float64:
        """Of the primary beam, of the shape of keV."""
        if self.height == 0:
            return np.ones(np.shape(keV))
        lead, open_ = (
            np.exp(-self.height * attenuation(m, keV)) for m in (self.septum_material, self.interspace_material)
        )
        return (self.septum * lead + self.interspace * open_) / (self.septum + self.interspace)

    def attenuation_table(self) -> Float64:
        """Of septa and of what is between them, (2, energies of the table), 1/mm."""
        return np.stack([attenuation(m, elements()["keV"]) for m in (self.septum_material, self.interspace_material)])


NO_GRID = AntiscatterGrid(0.0, 0.0, 0.0)
# Ratio 5 : 1, 31 lines a cm, septa of 0.065 mm: the mammographic grid of MC-GPU's input (Badal et al., Med. Phys. 48, 2021)
LINEAR_GRID = AntiscatterGrid(5 * (10 / 31 - 0.065), 0.065, 10 / 31 - 0.065)
GRIDS = {"none": NO_GRID, "linear": LINEAR_GRID}


@dataclass(frozen=True)
class Part:
    """An ellipsoid of one material about `centre`, cut by a box from `low` to `high`, mm; of infinite radii, the box."""

    material: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radii: tuple[float, float, float] = (EVERYWHERE * 10,) * 3

    def bounds(self) -> Float64:
        """Lowest and highest corner, (2, 3)."""
        c, r = np.array(self.centre), np.array(self.radii)
        return np.stack([np.maximum(self.low, c - r), np.minimum(self.high, c + r)])


@dataclass(frozen=True, eq=False)
class Detected:
    """Energy on each pixel by what it met, keV, (rows, columns); and the sums of all photons, keV."""

    primary: Float64
    compton: Float64
    rayleigh: Float64
    multiple: Float64
    emitted: float
    deposited: float
    escaped: float

    @property
    def scatter(self) -> Float64:
        """Compton, Rayleigh and multiple."""
        return self.compton + self.rayleigh + self.multiple


def scatter_image(
    parts: Sequence[Part],
    source: ArrayLike,
    field: ArrayLike,
    shape: tuple[int, int],
    pitch: float,
    corner: tuple[float, float],
    keV: ArrayLike,
    photons_of: ArrayLike,
    photons: int,
    seed: int,
    grid: AntiscatterGrid = NO_GRID,
    detector: tuple[str, float] | None = None,
) -> Detected:
    """The panel z = 0, rows along y, columns along x from `corner`, behind `parts`, of which a later one replaces others.

    source: (x, y, z) mm. field: x0, y0, x1, y1 of the panel's plane that the beam covers evenly. keV, photons_of: the
    spectrum. detector: what stops photons, and its thickness in mm; none stops all. Raises `DataError`.
    """
    lines, share = np.atleast_1d(np.asarray(keV, np.float64)), np.atleast_1d(np.asarray(photons_of, np.float64))
    if lines.shape != share.shape or (share < 0).any() or not share.sum() > 0:
        raise DataError("spectrum: expected one number of photons for each energy, some above 0")
    names = sorted({part.material for part in parts})
    bounds = np.array([part.bounds() for part in parts])
    solid = np.array([[*p.centre, *p.radii, *p.low, *p.high] for p in parts], np.float64)
    thickness = np.empty(0) if detector is None else detector[1] * attenuation(detector[0], elements()["keV"])
    energy, *sums = _core.scatter.scatter_image(
        *monte_carlo_tables(names),
        np.array([names.index(p.material) for p in parts], np.int64),
        solid,
        [bounds[:, 0].min(axis=0).tolist(), bounds[:, 1].max(axis=0).tolist()],
        [float(v) for v in np.asarray(source)],
        [float(v) for v in np.asarray(field)],
        lines,
        np.cumsum(share) / share.sum(),
        [corner[0], corner[1], pitch, pitch],
        shape[0],
        shape[1],
        thickness,
        (grid.height, grid.septum, grid.interspace),
        grid.attenuation_table(),
        photons,
        seed,
    )
    return Detected(*(energy * _core.scatter.unit), *(value * _core.scatter.unit for value in sums))


def pencil_kernels(
    material: str,
    thickness: float,
    keV: float,
    gaps: ArrayLike,
    radii: ArrayLike,
    grids: Sequence[AntiscatterGrid],
    photons: int,
    seed: int,
    tangent: float = 0.0,
) -> Float64:
    """(gaps, grids, rings + 1): keV scattered to each ring around a pencil beam through a slab without end.

    tangent: of its angle to the normal; it travels towards -x. Last, the sum over the rings of keV times x - that of the
    pencil, mm.
    """
    energy = _core.scatter.pencil_kernels(
        *monte_carlo_tables([material]),
        thickness,
        tangent,
        keV,
        np.asarray(gaps, np.float64),
        np.asarray(radii, np.float64),
        np.array([[g.height, g.septum, g.interspace] for g in grids], np.float64),
        np.array([g.attenuation_table() for g in grids]),
        photons,
        seed,
    )
    return np.asarray(energy * _core.scatter.unit)
