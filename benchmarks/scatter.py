"""Judges the Monte Carlo of scatter by published values, and the estimate of scatter by the Monte Carlo.

`python -m benchmarks.scatter` prints Markdown tables; `--photons` scales the runs. The estimate's table was made of slabs
with seeds 20 to 13,531 (benchmarks/scatter_tables.py). That thin parts lie as high as thick ones was chosen on five other
bodies, at 0, 12 and 25 degrees, with seeds from 5,000,000. The bodies here have other shapes, voltages, gaps and seeds. After
a first run on them (seeds from 7,000,000) the estimate learnt to take the thickness that the compression plate tells; both
ways are told.
"""

import argparse
from collections.abc import Iterator

import numpy as np

import palpate as pp
from palpate.scans.scatter.cross_sections import attenuation, mass_attenuation
from palpate.scans.scatter.kernels import tube_spectrum
from palpate.scans.scatter.monte_carlo import GRIDS, Part, scatter_image

SEED = 8_000_000
NIST = {  # Hubbell & Seltzer, NISTIR 5632 (1995), https://physics.nist.gov/xaamdi: 15, 20, 30, 40, 50, 60 keV, cm²/g
    "water": (1.673, 0.8096, 0.3756, 0.2683, 0.2269, 0.2059),
    "adipose ICRU-44": (1.083, 0.5677, 0.3063, 0.2396, 0.2123, 0.1974),
    "breast ICRU-44": (1.378, 0.6889, 0.3403, 0.2530, 0.2186, 0.2006),
}
ENERGIES = (15, 20, 30, 40, 50, 60)


def table(head: str, rows: Iterator[str]) -> None:
    columns = head.count("|") + 1
    print(f"\n| {head} |\n|{'---|' * columns}", flush=True)
    for row in rows:
        print(f"| {row} |", flush=True)


def cross_sections() -> Iterator[str]:
    for name, published in NIST.items():
        off = mass_attenuation(name, ENERGIES) / np.array(published) - 1
        yield f"{name} | {', '.join(f'{v:.2%}' for v in off)} | {np.abs(off).max():.2%}"


def boone(diameter: float, thickness: float) -> float:
    """Scatter over primary of semicircular breasts, Mo/Mo, 15 mm gap; cm (Boone et al., Med. Phys. 27:2408, 2000)."""
    return 1 / (-2.35452817439093 + 22.3960980055927 * diameter**-1.5 + 8.85064260299289 * thickness**-0.5)


def semicircles(photons: int) -> Iterator[str]:
    """At the centre of mass. Diameters: semicircles of the paper's least, median and largest breast, 58, 146, 298 cm²."""
    keV, lines = tube_spectrum(26, "Mo/Mo")
    offs = []
    for thickness in (2.0, 4.0, 6.0, 8.0):
        for diameter in (12.2, 19.3, 27.5):
            r, gap, high = 5 * diameter, 15.0, 10 * thickness
            body = [Part("breast", (-r, 0, gap), (r, r, gap + high), (0, 0, 0), (r, r, 1e7))]
            half = 1.1 * r
            pitch = 4.0
            shape = int(half / pitch) + 1, 2 * int(half / pitch) + 2
            corner = (-pitch * shape[1] / 2, 0.0)
            found = scatter_image(
                body, (0, 0, 650), (-half, 0, half, half), shape, pitch, corner, keV, lines, photons, SEED + int(high)
            )
            y, x = np.mgrid[: shape[0], : shape[1]] * pitch + pitch / 2
            centre = 4 * r / (3 * np.pi) * 650 / (650 - gap - high / 2)
            near = np.hypot(x + corner[0], y - centre) < 10
            slant = np.sqrt(1 + ((x + corner[0]) ** 2 + y**2)[near] / 650**2)  # the primary is exact, not drawn
            passed = np.exp(-high * slant[:, None] * attenuation("breast", keV)) @ (lines * keV) / lines.sum()
            primary = passed.sum() * photons * pitch**2 / (2 * half * half)
            ratio = found.scatter[near].sum() / primary
            published = boone(diameter, thickness)
            noise = np.sqrt(np.mean(keV) / found.scatter[near].sum())
            offs.append(ratio / published - 1)
            yield f"{thickness:g} | {diameter:g} | {published:.3f} | {ratio:.3f} | {offs[-1]:+.1%} | {noise:.1%}"
    inside = sum(abs(o) <= 0.1 for o in offs)
    yield f"all | | | | RMS {np.sqrt(np.mean(np.square(offs))):.1%}, {inside} of {len(offs)} within 10 % |"


# Beam stop, PMMA of 20 and 80 mm: the least and the largest of two systems without a grid, and of the one with a linear grid
# (Salvagnini et al., Med. Phys. 39:3167, 2012, of which only the abstract was read). Assumed: W/Rh at 25 and 32 kV, a field
# of 240 x 300 mm, 20 mm from PMMA to panel, 0.2 mm of selenium, nothing between.
PMMA = (("none", 20, 0.268), ("none", 80, 1.124), ("linear", 20, 0.052), ("linear", 80, 0.187))
# Primary and scatter that another linear grid lets through, 50 mm of breast, 28 kV Mo/Mo (Xia et al., Proc. SPIE 5745, 2005,
# abstract).
XIA = (0.73, 0.13)


def grids(photons: int) -> Iterator[str]:
    for grid, thickness, published in PMMA:
        found = slab("PMMA", thickness, 25 if thickness == 20 else 32, "W/Rh", grid, photons)
        ratio = found[1] / found[0]
        yield f"S/P, {thickness} mm of PMMA, grid {grid} | {published} | {ratio:.3f} | {ratio / published - 1:+.0%}"
    bare, behind = (slab("breast", 50, 28, "Mo/Mo", grid, photons) for grid in ("none", "linear"))
    for name, published, passed in zip(
        ("primary", "scatter"), XIA, (b / a for a, b in zip(bare, behind, strict=True)), strict=True
    ):
        yield f"{name} behind the grid, 50 mm of breast | {published} | {passed:.3f} | {passed / published - 1:+.0%}"


def slab(material: str, thickness: int, kv: int, beam: str, grid: str, photons: int) -> tuple[float, float]:
    """Primary and scatter 60 mm from the edge of a slab of 240 x 300 mm."""
    keV, lines = tube_spectrum(kv, beam)
    gap, low, high = 20.0, (-150, 0), (150, 240)
    body, size = [Part(material, (*low, gap), (*high, gap + thickness))], (12, 15)
    seed, screen = SEED + thickness, ("selenium", 0.2)
    found = scatter_image(
        body, (0, 0, 650), (*low, *high), size, 20.0, (-150.0, 0.0), keV, lines, photons, seed, GRIDS[grid], screen
    )
    return float(found.primary[2:4, 6:9].sum()), float(found.scatter[2:4, 6:9].sum())


# material, inserts' radii, height, half width and length towards the nipple, kV, beam, gap, grid. An ellipsoid, cut at the
# chest wall; a rounded slab is cut above and below too, a dome lies on its flat face.
BODIES = {
    "ellipsoid of 42 mm, insert": ("breast", (9.0,), 42.0, (68.0, 88.0), 27, "W/Rh", 12.0, "none"),
    "ellipsoid of 68 mm, inserts": ("breast", (14.0, 9.0), 68.0, (92.0, 118.0), 33, "W/Rh", 22.0, "none"),
    "rounded slab of 54 mm, inserts": ("breast", (11.0, 8.0), 54.0, (80.0, 100.0), 29, "W/Rh", 15.0, "none"),
    "rounded slab of 48 mm, fat": ("adipose", (10.0,), 48.0, (78.0, 92.0), 31, "W/Al", 28.0, "none"),
    "rounded slab of 37 mm, gland": ("glandular", (), 37.0, (66.0, 84.0), 27, "Mo/Mo", 15.0, "none"),
    "dome of 55 mm": ("breast", (8.0,), 55.0, (75.0, 95.0), 29, "W/Ag", 17.0, "none"),
    "rounded slab of 52 mm": ("breast", (10.0,), 52.0, (74.0, 96.0), 31, "W/Rh", 15.0, "linear"),
}
TILTS = (0, 9, 22)  # degrees
PITCH, AVERAGED = 2.0, 3  # mm; pixels whose mean is compared, against the noise of the Monte Carlo


def body_parts(name: str) -> list[Part]:
    material, inserts, high, (across, out), _, _, gap, _ = BODIES[name]
    centre, middle = (0.0, 0.0, gap + high / 2), gap + high / 2.2
    low, top = (-across, -out, gap), (across, out, gap + high)
    upright = 1.6 * high / 2 if name.startswith("rounded") else high / 2
    if name.startswith("dome"):
        centre, upright = (0.0, 0.0, gap), high
    parts = [Part(material, low, top, centre, (across, out, upright))]
    for k, radius in enumerate(inserts):
        x, y = -25.0 + 45 * k, 30.0 + 15 * k
        box = (x - radius, y - radius, middle - radius), (x + radius, y + radius, middle + radius)
        parts.append(Part(("glandular", "adipose")[k % 2], *box, (x, y, middle), (radius,) * 3))
    return parts


def blocks(image: np.ndarray) -> np.ndarray:
    rows, columns = image.shape
    return image.reshape(rows // AVERAGED, AVERAGED, columns // AVERAGED, AVERAGED).mean(axis=(1, 3))


def imaged(name: str, tilt: float, photons: int) -> tuple[pp.Scan, np.ndarray]:
    """A scan of one view with the scatter of the Monte Carlo in it, and that scatter.

    Beam and body go on 60 mm beyond the chest wall's edge of the panel.
    """
    _, _, high, (across, out), kv, beam, gap, grid = BODIES[name]
    keV, lines = tube_spectrum(kv, beam)
    lean = np.tan(np.radians(tilt))
    source = 650 * np.array([np.sin(np.radians(tilt)), 0, np.cos(np.radians(tilt))])
    half = across * 1.15 + (gap + high) * lean * 0.6
    columns, rows = 2 * int(half / PITCH / AVERAGED) * AVERAGED, int(1.2 * out / PITCH / AVERAGED) * AVERAGED
    corner = (-(gap + high / 2) * lean - columns * PITCH / 2, 0.0)
    field = (corner[0], -60.0, corner[0] + columns * PITCH, rows * PITCH)
    seed, size = SEED + 100 * list(BODIES).index(name) + int(tilt), (rows, columns)
    found = scatter_image(body_parts(name), source, field, size, PITCH, corner, keV, lines, photons, seed, GRIDS[grid])
    photon = lines @ keV / lines.sum()  # its mean energy
    passed = lines @ (keV * GRIDS[grid].transmission(keV)) / (lines @ keV)
    incident = photons * passed * PITCH**2 / ((field[2] - field[0]) * (field[3] - field[1]))
    panel = pp.Panel(size, (PITCH, PITCH), (corner[0] + PITCH / 2, PITCH / 2, 0))
    scatter = found.scatter / photon
    return pp.Scan((found.primary / photon + scatter)[None], incident, pp.Views(source[None], panel)), scatter


def judged(photons: int, tilts: tuple[int, ...] = TILTS) -> Iterator[str]:
    for name, (_, _, high, _, kv, beam, gap, grid) in BODIES.items():
        kernels = pp.scatter_kernels(kv, beam, grid)
        for tilt in tilts if grid == "none" else (0,):
            scan, scatter = imaged(name, tilt, photons)
            t, p = blocks(scatter), blocks(scan.counts[0] - scatter)
            shadow = p < 0.97 * scan.incident.max()
            inner = shadow & np.roll(shadow, 1, 1) & np.roll(shadow, -1, 1)
            inner[:-1] &= shadow[1:]
            skin = shadow & ~inner

            estimates = [pp.estimate_scatter(scan, kernels, gap, thickness)[0] for thickness in (None, high)]
            cells = [
                f"{100 * np.sqrt(np.mean((blocks(e) / t - 1)[there] ** 2)):.1f}"
                for e in estimates
                for there in (shadow, skin)
            ]
            clean = pp.Scan(scan.counts - scatter, scan.incident, scan.views)
            false = blocks(pp.estimate_scatter(clean, kernels, gap)[0])
            noise = np.sqrt(np.mean(1 / (t[shadow] * AVERAGED**2)))
            off = blocks(estimates[0])[shadow].sum() / t[shadow].sum() - 1
            yield (
                f"{name}, {kv} kV {beam}, gap {gap:g} mm, grid {grid} | {tilt} | {t[shadow].sum() / p[shadow].sum():.2f} | "
                f"{' | '.join(cells)} | {100 * off:+.1f} | {100 * noise:.1f} | {false[shadow].sum() / p[shadow].sum():.2f}"
            )


def picture(path: str, photons: int) -> None:
    """Scatter over incident, of the Monte Carlo and estimated, for one body seen at 22 degrees; and along a row."""
    import matplotlib.pyplot as plt

    name, tilt = "rounded slab of 54 mm, inserts", 22
    _, _, high, _, kv, beam, gap, _ = BODIES[name]
    scan, scatter = imaged(name, tilt, photons)
    estimate = pp.estimate_scatter(scan, pp.scatter_kernels(kv, beam), gap, thickness=high)[0]
    shown = [100 * image / scan.incident.max() for image in (scatter, estimate)]
    figure, axes = plt.subplots(1, 3, figsize=(10, 2.8), layout="constrained", width_ratios=[1, 1, 1.1])
    for ax, image, title in zip(axes, shown, ("Monte Carlo", "estimate"), strict=False):
        drawn = ax.imshow(image, vmin=0, vmax=shown[1].max() * 1.2, origin="lower", cmap="magma")
        ax.set(title=title, xticks=[], yticks=[])
    figure.colorbar(drawn, ax=axes[:2], label="scatter, % of the open beam")
    x = PITCH * (np.arange(scatter.shape[1]) - scatter.shape[1] / 2)
    for image, label in zip(shown, ("Monte Carlo", "estimate"), strict=True):
        axes[2].plot(x, image[8:14].mean(axis=0), label=label)
    axes[2].set(title="12 to 28 mm from the chest wall", xlabel="mm", ylabel="%", ylim=(0, None))
    axes[2].legend(frameon=False)
    figure.savefig(path, dpi=110)


def means(photons: int) -> Iterator[str]:
    """Mean attenuation inside the rounded slab of 54 mm, nine views over 40 degrees: off that without any scatter."""
    name = "rounded slab of 54 mm, inserts"
    _, _, high, (across, out), kv, beam, gap, _ = BODIES[name]
    keV, lines = tube_spectrum(kv, beam)
    photon, kernels, pitch = lines @ keV / lines.sum(), pp.scatter_kernels(kv, beam), 2.0
    shape, corner = (60, 120), (-120.0, 0.0)
    field = (corner[0], -60.0, -corner[0], shape[0] * pitch)
    angles = np.linspace(-20, 20, 9)
    views = pp.arc_views(
        pp.Panel(shape, (pitch, pitch), (corner[0] + pitch / 2, pitch / 2, 0)),
        angles,
        radius=650 - 40,
        pivot=(0, 0, 40),
    )
    found = [
        scatter_image(body_parts(name), s, field, shape, pitch, corner, keV, lines, photons, SEED + 5000 + k)
        for k, s in enumerate(views.source)
    ]
    primary, scatter = (np.array([getattr(f, n) for f in found]) / photon for n in ("primary", "scatter"))
    incident = photons * pitch**2 / ((field[2] - field[0]) * (field[3] - field[1]))
    dose = 20_000 / incident  # 20,000 quanta a pixel; all cases share the noise of the Monte Carlo
    primary, scatter, incident = primary * dose, scatter * dose, incident * dose
    mixed = pp.Scan(primary + scatter, incident, views)
    clean = pp.Scan(primary, incident, views)
    estimate = pp.estimate_scatter(mixed, kernels, gap)
    grid = pp.Grid.centred((12, 60, 84), (high / 9, 2, 2), y=59, z=gap + high / 2)
    z, y, x = np.meshgrid(*(grid.axis(a) for a in "zyx"), indexing="ij")
    inside = (np.abs(z - gap - high / 2) < high / 2 - 6) & (np.hypot(x / (across - 12), y / (out - 12)) < 1) & (y > 6)

    def mean(scan: pp.Scan, background: np.ndarray | float) -> float:
        told = pp.Scan(scan.counts, scan.incident, views, background)
        return float(pp.reconstruct(told, grid, iterations=30).values[inside].mean())

    right = mean(clean, 0)
    cases = {
        "scatter in the counts; none told": (mixed, 0.0),
        "the true scatter told": (mixed, scatter),
        "the estimate told": (mixed, estimate),
        "15 % more than the estimate": (mixed, 1.15 * estimate),
        "15 % less than the estimate": (mixed, 0.85 * estimate),
        "no scatter in the counts; none told": (clean, 0.0),
        "no scatter in the counts; the estimate told": (clean, pp.estimate_scatter(clean, kernels, gap)),
    }
    for case, (scan, background) in cases.items():
        yield f"{case} | {mean(scan, background) / right - 1:+.1%}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photons", type=int, default=60_000_000, help="of each run")
    parser.add_argument("--only", choices=["cross", "boone", "grids", "judged", "means"], help="one of the tables")
    parser.add_argument("--picture", help="write a picture instead")
    given = parser.parse_args()
    if given.picture:
        picture(given.picture, given.photons)
        return
    n = given.photons
    if given.only in (None, "cross"):
        table("μ/ρ | off NIST's at 15, 20, 30, 40, 50, 60 keV | most", cross_sections())
    if given.only in (None, "boone"):
        table("cm thick | cm wide | published S/P | Monte Carlo | off | noise of 1 σ", semicircles(n))
    if given.only in (None, "grids"):
        table("what was measured | published | Monte Carlo | off", grids(n // 3))
    if given.only in (None, "judged"):
        head = (
            "body, beam | tilt, ° | S/P | RMS, % | RMS at the skin line, % | thickness told: RMS, % | at the skin line, % | "
            "mean, % | noise of 1 σ, % | estimated S/P without scatter"
        )
        table(head, judged(n))
    if given.only in (None, "means"):
        table("mean attenuation inside a body | off", means(n // 6))


if __name__ == "__main__":
    main()
