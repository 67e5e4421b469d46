"""How materials weaken and scatter X-rays of 5 to 150 keV: a table by element, and mixtures of it.

The table is made by `benchmarks/scatter_tables.py` from xraylib; `tables/README.md` names the sources.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import ArrayLike, Float64
from palpate.errors import DataError

TABLES = Path(__file__).parent / "tables"
PROCESSES = ("photo", "rayleigh", "compton")


@dataclass(frozen=True)
class Material:
    """Density, g/cm³, and the share of each element (atomic number) in the mass."""

    density: float
    fractions: Mapping[int, float]


# Adipose and glandular: Hammerstein et al., Radiology 130:485, 1979. ICRU-44: NIST, table 2 of Hubbell & Seltzer (1995).
_FAT = {1: 0.112, 6: 0.619, 7: 0.017, 8: 0.251, 15: 0.00025, 16: 0.00025, 19: 0.00025, 20: 0.00025}
_GLAND = {1: 0.102, 6: 0.184, 7: 0.032, 8: 0.677, 15: 0.00125, 16: 0.00125, 19: 0.00125, 20: 0.00125}
MATERIALS = {
    "water": Material(1.0, {1: 0.111898, 8: 0.888102}),
    "adipose": Material(0.93, _FAT),
    "glandular": Material(1.04, _GLAND),
    "breast": Material(2 / (1 / 0.93 + 1 / 1.04), {z: (_FAT[z] + _GLAND[z]) / 2 for z in _FAT}),  # equal masses
    "adipose ICRU-44": Material(0.95, {1: 0.114, 6: 0.598, 7: 0.007, 8: 0.278, 11: 0.001, 16: 0.001, 17: 0.001}),
    "breast ICRU-44": Material(
        1.02, {1: 0.106, 6: 0.332, 7: 0.03, 8: 0.527, 11: 0.001, 15: 0.001, 16: 0.002, 17: 0.001}
    ),
    "calcium oxalate": Material(2.12, {1: 0.013797, 6: 0.164403, 8: 0.547505, 20: 0.274295}),  # CaC2O4·H2O
    "PMMA": Material(1.19, {1: 0.080538, 6: 0.599848, 8: 0.319614}),
    "polystyrene": Material(1.06, {1: 0.077418, 6: 0.922582}),
    "lead": Material(11.35, {82: 1.0}),
    "selenium": Material(4.3, {34: 1.0}),  # amorphous
}


@cache
def elements() -> dict[str, Any]:
    """The table: keV (energies,), x (momenta,) 1/Å, z, photo, rayleigh, compton cm²/g (z, energies), F and S (z, x)."""
    with np.load(TABLES / "cross_sections.npz") as file:
        return {name: file[name].astype(np.float64) for name in file.files}


def material(name: str) -> Material:
    """A material by name. Raises `DataError`."""
    if name not in MATERIALS:
        raise DataError(f"material: there is no {name!r}; choose from {', '.join(MATERIALS)}")
    return MATERIALS[name]


def mass_attenuation(name: str, keV: ArrayLike, processes: Sequence[str] = PROCESSES) -> Float64:
    """μ/ρ of a material in cm²/g, by all processes or some, of the shape of keV. Raises `DataError`."""
    at = np.asarray(keV, dtype=np.float64)
    table = elements()
    if at.size and (at.min() < table["keV"][0] or at.max() > table["keV"][-1]):
        raise DataError(f"energy: the table has {table['keV'][0]:g} to {table['keV'][-1]:g} keV, got {keV!r}")
    values = sum(mixture(name, process) for process in processes)
    return np.exp(np.interp(np.log(at), np.log(table["keV"]), np.log(values)))


def attenuation(name: str, keV: ArrayLike) -> Float64:
    """μ of a material, 1/mm."""
    return mass_attenuation(name, keV) * material(name).density / 10


def mixture(name: str, process: str) -> Float64:
    """Cross section of a process, cm²/g, (energies,)."""
    table = elements()
    found = np.zeros(len(table["keV"]))
    for z, share in material(name).fractions.items():
        found += share * table[process][list(table["z"]).index(z)]
    return found


def monte_carlo_tables(names: Sequence[str]) -> tuple[float, float, Float64, Float64, Float64, Float64]:
    """What `_core.scatter` takes of materials: see cpp/scatter/materials.h."""
    table = elements()
    log, x = np.log(table["keV"]), table["x"]
    mu = np.array([[mixture(n, p) * material(n).density / 10 for n in names] for p in PROCESSES])
    squared, share = np.empty((len(names), len(x))), np.empty((len(names), len(x)))
    for k, name in enumerate(names):
        z, weight = np.array(list(material(name).fractions.items())).T
        rows = [list(table["z"]).index(each) for each in z]
        atoms = weight / table["mass"][rows]
        squared[k] = atoms @ table["F"][rows] ** 2  # atoms scatter independently of each other
        share[k] = atoms @ table["S"][rows] / (atoms @ z)
    steps = np.diff(x**2) * (squared[:, 1:] + squared[:, :-1]) / 2
    integral = np.concatenate([np.zeros((len(names), 1)), np.cumsum(steps, axis=1)], axis=1)
    return float(log[0]), float(log[1] - log[0]), mu, x, integral, share
