"""The table of scatter kernels: how much a slab scatters to each place around a pencil of X-rays."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from palpate.arrays import Float64
from palpate.errors import DataError
from palpate.scans.scatter.cross_sections import TABLES, attenuation
from palpate.scans.scatter.monte_carlo import GRIDS

REACH = 100.0  # mm around a pencil within which its scatter is superposed
MATERIAL = "breast"  # of the slabs: equal masses of adipose and glandular tissue


@dataclass(frozen=True, eq=False)
class ScatterKernels:
    """Scatter of slabs under one beam: what `scatter_kernels` reads from the table.

    Parameters
    ----------
    thickness : ndarray, (n,)
        Of the slabs, mm, from 0, rising.
    transmission : ndarray, (n,)
        Primary signal behind each slab over that of the open beam.
    gap : ndarray, (gaps,)
        Distances from the slab to the panel, mm, rising.
    radius : ndarray, (rings + 1,)
        Edges of the rings around the pencil, mm.
    scatter : ndarray, (n, gaps, rings)
        Signal scattered to each ring over that of the pencil in the open beam.
    gain, shift : ndarray, (n, gaps)
        Of a pencil at an angle of `tangent` to the normal, of the same thickness and gap along it: its scatter over that of
        an upright one, less 1, and how far it lies off the pencil towards the normal, mm.
    tangent : float
        Of that angle.
    assumed : mapping of str to str
        What the kernels are for: kV, beam, grid, material.

    Examples
    --------
    >>> kernels = pp.scatter_kernels(kv=30, beam="W/Rh")
    >>> bool((np.diff(kernels.transmission) < 0).all())
    True
    """

    thickness: Float64
    transmission: Float64
    gap: Float64
    radius: Float64
    scatter: Float64
    gain: Float64
    shift: Float64
    tangent: float
    assumed: Mapping[str, str]

    def kernel(self, k: int, gap: float, tangent: float = 0.0) -> tuple[Float64, float]:
        """Return the kernel of a slab, linear between the gaps of the table.

        Parameters
        ----------
        k : int
            Which thickness.
        gap : float
            From the slab to the panel along the ray, mm.
        tangent : float, optional
            Of the ray's angle to the panel's normal. The shift grows with it, the gain with its square.

        Returns
        -------
        rings : ndarray, (rings,)
            Signal scattered to each ring over that of the ray in the open beam.
        shift : float
            How far the rings lie off the ray towards the normal, mm.
        """
        at = min(float(np.interp(gap, self.gap, np.arange(len(self.gap)))), len(self.gap) - 1 - 1e-9)
        low, part, oblique = int(at), at % 1, tangent / self.tangent
        rings, gain, shift = (
            (1 - part) * each[k, low] + part * each[k, low + 1] for each in (self.scatter, self.gain, self.shift)
        )
        return rings * (1 + gain * oblique**2), float(shift) * oblique


def scatter_kernels(kv: float, beam: str = "W/Rh", antiscatter_grid: str = "none") -> ScatterKernels:
    """Return the kernels of slabs of breast tissue for a beam, from the table that palpate ships.

    The table was made by palpate's own Monte Carlo, for a panel that detects all energy.

    Parameters
    ----------
    kv : float
        Tube voltage, kV: 22 to 50.
    beam : str, optional
        Anode and filter: "W/Rh" (0.05 mm), "W/Ag" (0.05 mm), "W/Al" (0.7 mm), "Mo/Mo" (0.03 mm) or "Rh/Rh" (0.025 mm).
    antiscatter_grid : str, optional
        "none", or "linear" with ratio 5 and 31 lines a cm.

    Returns
    -------
    ScatterKernels
        For any air gap of 0 to 80 mm and thickness of 0 to 120 mm.

    Raises
    ------
    DataError
        If the table has no such beam.

    References
    ----------
    Boone & Cooper, Med. Phys. 27:1818, 2000.

    Examples
    --------
    >>> pp.scatter_kernels(kv=29, antiscatter_grid="linear").assumed["anti-scatter grid"]
    'linear'
    """
    lines, photons = tube_spectrum(kv, beam)
    table = _table()
    names = [str(name) for name in table["grid"]]
    if antiscatter_grid not in names:
        raise DataError(f"antiscatter_grid: there is no {antiscatter_grid!r}; choose from {', '.join(names)}")
    k = names.index(antiscatter_grid)
    thickness = np.concatenate([[0.0], table["thickness"]])
    signal = photons * lines * GRIDS[antiscatter_grid].transmission(lines)
    passed = np.exp(-np.outer(thickness, attenuation(MATERIAL, lines)))  # (n, lines)
    at = np.clip(np.interp(lines, table["keV"], np.arange(len(table["keV"]))), 0, len(table["keV"]) - 1 - 1e-9)
    low, part = at.astype(int), at % 1
    sent = photons * lines / signal.sum()  # the table's ratios are to the primary without a grid

    def summed(name: str) -> Float64:
        """A ratio of the table, (energies, thickness, gap, grid, ...), over all lines; 0 for no thickness."""
        ratios = np.moveaxis(table[name][:, :, :, k].astype(np.float64), 0, -1)
        whole = ((1 - part) * ratios[..., low] + part * ratios[..., low + 1]) @ np.diag(sent)
        found = np.einsum("nl,n...l->n...", passed[1:], whole)
        return np.concatenate([np.zeros((1, *found.shape[1:])), found])

    scatter, oblique = summed("scatter"), summed("oblique")
    within = scatter[..., : np.searchsorted(table["radius"], REACH, "right") - 1].sum(axis=-1)
    scatters = within > 0
    gain = np.where(scatters, oblique[..., 0] / np.where(scatters, within, 1) - 1, 0)
    shift = np.where(scatters, oblique[..., 1] / np.where(scatters, oblique[..., 0], 1), 0)
    return ScatterKernels(
        thickness,
        passed @ signal / signal.sum(),
        table["gap"],
        table["radius"],
        scatter,
        gain,
        shift,
        float(table["tangent"]),
        {
            "kV": f"{kv:g}",
            "beam": beam,
            "anti-scatter grid": antiscatter_grid,
            "material": f"{MATERIAL}, adipose and glandular 1:1",
        },
    )


def tube_spectrum(kv: float, beam: str) -> tuple[Float64, Float64]:
    """Photons of each line, keV, of a tube; between two voltages of the table, their mean. Raises `DataError`."""
    with np.load(TABLES / "spectra.npz") as file:
        names, known = [str(name) for name in file["beam"]], file["kv"].astype(np.float64)
        if beam not in names:
            raise DataError(f"beam: there is no {beam!r}; choose from {', '.join(names)}")
        if not known[0] <= kv <= known[-1]:
            raise DataError(f"kv: the table has {known[0]:g} to {known[-1]:g} kV, got {kv!r}")
        at = min(float(np.interp(kv, known, np.arange(len(known)))), len(known) - 1 - 1e-9)
        one, next_ = file["photons"][names.index(beam)][int(at) : int(at) + 2].astype(np.float64)
        photons = one * (1 - at % 1) + next_ * (at % 1)
        seen = photons > 0
        return file["keV"][seen].astype(np.float64), photons[seen]


@cache
def _table() -> dict[str, Any]:
    with np.load(TABLES / "kernels.npz") as file:
        return {name: file[name] for name in file.files}
