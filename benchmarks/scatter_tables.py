"""Makes the tables that palpate ships for scatter: cross sections, tube spectra and kernels.

`python -m benchmarks.scatter_tables cross-sections spectra kernels` writes them to src/palpate/scans/scatter/tables of
the palpate that is imported, or to the folder of --to. The first two need xraylib and spekpy (`pip install
palpate[scatter]`), the last only palpate; it takes some minutes.
"""

import argparse
from pathlib import Path

import numpy as np

from palpate.scans.scatter import cross_sections, kernels, monte_carlo

ELEMENTS = (1, 6, 7, 8, 11, 12, 15, 16, 17, 19, 20, 34, 82)
KEV = np.geomspace(5, 150, 300)
X = np.concatenate([[0], np.geomspace(0.005, 13, 400)])  # sin(angle/2)/wavelength, 1/angstrom

# Anode and filter, mm, behind a window of 0.8 mm of beryllium and 600 mm of air; anodes at 12 degrees.
BEAMS = {
    "W/Rh": ("W", "Rh", 0.05),
    "W/Ag": ("W", "Ag", 0.05),
    "W/Al": ("W", "Al", 0.7),
    "Mo/Mo": ("Mo", "Mo", 0.03),
    "Rh/Rh": ("Rh", "Rh", 0.025),
}
KV = np.arange(22, 51, 2)
LINES = np.arange(6, 50.5, 1.0)  # keV, middles of bins of 1 keV

ENERGIES = np.array([10, 12, 14, 16, 18, 20, 22, 25, 28, 32, 36, 40, 45, 50.0])
THICKNESS = np.array([2, 5, 10, 20, 30, 40, 50, 60, 70, 80, 100, 120.0])
GAPS = np.array([0, 10, 20, 40, 80.0])
RADII = np.concatenate([[0], np.geomspace(1, 300, 36)])
PHOTONS, SEED = 2_000_000, 20
TILT = np.radians(25.0)  # of the oblique pencil


def make_cross_sections() -> dict[str, np.ndarray]:
    import xraylib as x

    def of(f, at):
        return np.array([[f(z, float(value)) for value in at] for z in ELEMENTS], np.float32)

    return {
        "keV": KEV,
        "x": X,
        "z": np.array(ELEMENTS),
        "mass": np.array([x.AtomicWeight(z) for z in ELEMENTS]),
        "photo": of(x.CS_Photo, KEV),
        "rayleigh": of(x.CS_Rayl, KEV),
        "compton": of(x.CS_Compt, KEV),
        "F": of(lambda z, q: x.FF_Rayl(z, q) if q else z, X),
        "S": of(lambda z, q: x.SF_Compt(z, q) if q else 0.0, X),
    }


def make_spectra() -> dict[str, np.ndarray]:
    import spekpy

    found = np.zeros((len(BEAMS), len(KV), len(LINES)), np.float32)
    for b, (anode, filtered, thickness) in enumerate(BEAMS.values()):
        for k, kv in enumerate(KV):
            model = spekpy.Spek(kvp=float(kv), targ=anode, th=12, dk=0.1, physics="kqp")
            model.filter("Be", 0.8).filter(filtered, thickness).filter("Air", 600)
            energy, photons = model.get_spectrum(edges=False)
            edges = np.append(LINES - 0.5, LINES[-1] + 0.5)
            found[b, k] = np.histogram(energy, edges, weights=photons * 0.1)[0]
            found[b, k] /= found[b, k].sum()
    return {"beam": np.array(list(BEAMS)), "kv": KV, "keV": LINES, "photons": found}


def make_kernels(photons: int = PHOTONS) -> dict[str, np.ndarray]:
    """Energy scattered to each ring over the energy of the primary, both of a pencil beam, float32.

    oblique: the same within `REACH`, and its moment in mm, for a pencil at 25 degrees to the normal; thickness and gap
    are along the pencil.
    """
    grids = list(monte_carlo.GRIDS.values())
    found = np.zeros((len(ENERGIES), len(THICKNESS), len(GAPS), len(grids), len(RADII) - 1), np.float32)
    oblique = np.zeros((*found.shape[:-1], 2), np.float32)
    rings = RADII[: np.searchsorted(RADII, kernels.REACH, "right")]
    for e, keV in enumerate(ENERGIES):
        mu = cross_sections.attenuation(kernels.MATERIAL, keV)
        for t, thickness in enumerate(THICKNESS):
            seed, primary = SEED + 1000 * e + t, photons * keV * np.exp(-mu * thickness)
            energy = monte_carlo.pencil_kernels(kernels.MATERIAL, thickness, keV, GAPS, RADII, grids, photons, seed)
            found[e, t] = energy[..., :-1] / primary
            slanted = monte_carlo.pencil_kernels(
                kernels.MATERIAL,
                thickness * np.cos(TILT),
                keV,
                GAPS * np.cos(TILT),
                rings,
                grids,
                photons,
                seed + 500,
                np.tan(TILT),
            )
            oblique[e, t] = np.stack([slanted[..., :-1].sum(axis=-1), slanted[..., -1]], axis=-1) / primary
    axes = {
        "keV": ENERGIES,
        "thickness": THICKNESS,
        "gap": GAPS,
        "grid": np.array(list(monte_carlo.GRIDS)),
        "radius": RADII,
    }
    return {**axes, "scatter": found, "tangent": np.tan(TILT), "oblique": oblique}


MADE = {"cross-sections": make_cross_sections, "spectra": make_spectra, "kernels": make_kernels}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tables", nargs="+", choices=MADE)
    parser.add_argument("--to", type=Path, default=cross_sections.TABLES)
    given = parser.parse_args()
    for name in given.tables:
        np.savez_compressed(given.to / f"{name.replace('-', '_')}.npz", **MADE[name]())


if __name__ == "__main__":
    main()
