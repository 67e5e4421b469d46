"""What blur in the model is worth, and what it costs: `python -m benchmarks.blur --plot docs/images/blur.png` (minutes).

image        A calcification in a ball, seen through a focal spot of many point sources and a panel that spreads light
             (`tests/support/blurred_scans.py`, which shares nothing with the model). Each strength of the quadratic prior
             gives one noise; without and with blur in the model are compared at equal noise, and last with the weakest
             prior. FWHM and height are those of the difference that the calcification makes to a volume without noise;
             100 % is the mean of the true attenuation over its middle voxel. Noise is the standard deviation in the ball.
convergence  Iterations from a uniform start until Φ has come down to within a share of the way to its minimum. *EM descent*
             takes the curvature of the EM surrogate, which never raises Φ; the rest take the quicker one.
cost         CPU seconds of one iteration of the memory gradient with blur over without, by turns, and of one sweep.
"""

import argparse
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from scipy.interpolate import CubicSpline
from support.blurred_scans import expected_transmission

import palpate as pp
from benchmarks.interleaved_timing import header, medians, row
from benchmarks.workloads import WORKLOADS, smooth
from palpate.arrays import Float32, Float64
from palpate.reconstruction.models.likelihood import Likelihood, Transmission
from palpate.reconstruction.optimizers.coordinate_descent import coordinate_descent, data_curvature
from palpate.reconstruction.optimizers.hybrid_descent import hybrid_descent
from palpate.reconstruction.optimizers.memory_gradient import memory_gradient
from palpate.reconstruction.optimizers.ordered_subsets import ordered_subsets
from palpate.reconstruction.optimizers.problem import Problem
from palpate.reconstruction.prior_parameters import median_curvature

STRENGTHS = np.geomspace(0.03, 10, 6)  # 1/mm; both curves of noise are interpolated between them
SHARES = (1e-2, 1e-3, 1e-4)
SEED, MOST, ENOUGH = 3, 60, 150  # iterations that are watched, and those that find the minimum


@dataclass(frozen=True, eq=False)
class Case:
    """A ball and a calcification (centre, radius mm, 1/mm) before a source and a panel."""

    name: str
    views: pp.Views
    grid: pp.Grid
    ball: tuple[Float64, float, float]
    speck: tuple[Float64, float, float]
    photons: float
    blur: pp.Blur

    def scan(self, *, speck: bool, seed: int | None) -> pp.Scan:
        """Counts, without noise where there is no seed."""
        bodies = [self.ball, self.speck] if speck else [self.ball]
        mean = self.photons * expected_transmission(bodies, self.views, self.blur.panel, self.blur.focal_spot)
        counts = mean if seed is None else np.random.default_rng(seed).poisson(mean)
        return pp.Scan(counts.astype(np.float32), self.photons, self.views, blur=self.blur)


def cases() -> list[Case]:
    """A micro-CT at magnification 2, and breast tomosynthesis with a calcification 45 mm above the panel."""
    near = pp.orbit_views((48, 48), (0.2, 0.2), source_to_centre=60, source_to_panel=120, count=24, arc=200)
    panel = pp.Panel((64, 64), (0.1, 0.1), (-3.15, -3.15, 0))
    arc = pp.arc_views(panel, np.linspace(-25, 25, 15), radius=620, pivot=(0, 0, 45))
    return [
        Case(
            "magnification 2, 24 views",
            near,
            pp.Grid.centred((40, 54, 54), (0.08, 0.08, 0.08)),
            (np.zeros(3), 2.0, 0.05),
            (np.array([0.68, 0.44, 0.04]), 0.1, 1.0),
            2e4,
            pp.Blur(panel=0.3, focal_spot=0.4, at=(0, 0, 0)),
        ),
        Case(
            "tomosynthesis ±25°, 15 views",
            arc,
            pp.Grid.centred((12, 64, 64), (0.5, 0.08, 0.08), z=45),
            (np.array([0, 0, 45.0]), 2.4, 0.05),
            (np.array([0.68, 0.44, 45.25]), 0.1, 1.0),
            2e4,
            pp.Blur(panel=0.2, focal_spot=0.3, at=(0, 0, 45)),
        ),
    ]


@dataclass(frozen=True, eq=False)
class Images:
    """Of one strength: noise 1/mm, FWHM mm, height (share), and the calcification's own image along x."""

    noise: float
    width: float
    height: float
    profile: Float64


def images(case: Case, scans: list[pp.Scan], blur: pp.Blur | None) -> list[Images]:
    """One for each of `STRENGTHS`. scans: with noise, without, and without the calcification too."""
    grid, (centre, radius, attenuation) = case.grid, case.speck
    z, y, x = (int(i) for i in grid.indices(centre)[0].round())
    fine = pp.Grid.centred((24,) * 3, np.array(grid.spacing) / 24)  # points of the middle voxel
    points = np.stack(np.indices(fine.shape), axis=-1).reshape(-1, 3)
    inside = np.linalg.norm(fine.points(points) + grid.points((z, y, x))[0] - centre, axis=1) < radius
    places = grid.points(np.stack(np.indices(grid.shape), axis=-1).reshape(-1, 3)).reshape(*grid.shape, 3)
    flat = np.linalg.norm(places - case.ball[0], axis=-1) < 0.75 * case.ball[1]
    flat &= np.linalg.norm((places - centre)[..., :2], axis=-1) > 5 * radius
    found = []
    for strength in STRENGTHS:
        options = {"prior": pp.Prior("quadratic", strength=float(strength)), "iterations": 40, "tolerance": 0.0}
        volumes = [pp.reconstruct(replace(s, blur=blur), grid, levels=2, **options) for s in scans]
        one, other, without = (volume.values.astype(np.float64) for volume in volumes)
        line = (other - without)[z, y]
        roots = CubicSpline(np.arange(len(line)), line - line[x] / 2).roots(extrapolate=False)
        width = (roots[roots > x].min() - roots[roots < x].max()) * grid.spacing[2]
        found.append(Images(float((one - other)[flat].std()), width, line[x] / (attenuation * inside.mean()), line))
    return found


def at_noise(found: list[Images], noise: float) -> tuple[float, float, float]:
    """(strength, width, height) where a curve has this noise."""
    order = np.argsort([i.noise for i in found])
    x = np.log([found[k].noise for k in order])
    y = [[np.log(STRENGTHS[k]), found[k].width, found[k].height] for k in order]
    strength, width, height = (float(np.interp(np.log(noise), x, column)) for column in np.array(y).T)
    return float(np.exp(strength)), width, height


def image_lines(plot: str | None) -> Iterator[str]:
    """The table of images."""
    yield header("scan", "noise, 1/mm", "FWHM without, mm", "with", "height without", "with")
    shown = []
    for case in cases():
        scans = [case.scan(speck=s, seed=k) for s, k in ((True, SEED), (True, None), (False, None))]
        without, blurred = images(case, scans, None), images(case, scans, case.blur)
        low = max(min(i.noise for i in found) for found in (without, blurred))
        high = min(max(i.noise for i in found) for found in (without, blurred))
        for noise in np.geomspace(low, high, 4)[::-1]:
            (_, w0, h0), (_, w1, h1) = at_noise(without, noise), at_noise(blurred, noise)
            yield row(case.name, f"{noise:.2g}", f"{w0:.3f}", f"{w1:.3f}", f"{h0:.0%}", f"{h1:.0%}")
        i, k = without[0], blurred[0]  # of the weakest prior
        noise = f"{i.noise:.2g}, {k.noise:.2g}"
        yield row(case.name, noise, f"{i.width:.3f}", f"{k.width:.3f}", f"{i.height:.0%}", f"{k.height:.0%}")
        shown.append((case, without, blurred))
    if plot:
        picture(plot, shown)


def picture(path: str, shown: list[tuple[Case, list[Images], list[Images]]]) -> None:
    """Above: the calcification's image along x at equal noise. Below: height by noise."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, len(shown), figsize=(4 * len(shown), 5.6), layout="constrained", squeeze=False)
    for (case, without, blurred), (above, below) in zip(shown, axes.T, strict=True):
        grid, x = case.grid, case.grid.indices(case.speck[0])[0][2]
        target = max(without, key=lambda i: i.noise).noise
        pair = [without[0], min(blurred, key=lambda i: abs(np.log(i.noise / target)))]
        far = (np.arange(grid.shape[2]) - x) * grid.spacing[2]
        for chosen, found, name in zip(pair, (without, blurred), ("without", "with blur in the model"), strict=True):
            above.plot(far, chosen.profile, label=f"{name}, noise {chosen.noise:.2g}/mm")
            below.plot([1000 * i.noise for i in found], [100 * i.height for i in found], "o-", ms=3, label=name)
        above.axvspan(-case.speck[1], case.speck[1], color="0.9")
        above.set(
            title=case.name, xlabel="mm from its middle (grey: the calcification)", ylabel="1/mm", xlim=(-0.9, 0.9)
        )
        below.set(xlabel="noise, 1/m", ylabel="height, % of the truth", ylim=(0, None))
        above.set_ylim(top=1.3 * pair[1].profile.max())  # room for the legend
        for ax in (above, below):
            ax.legend(frameon=False, fontsize=8, loc="upper left")
    figure.savefig(path, dpi=100)


def convergence_lines() -> Iterator[str]:
    """The table of iterations."""
    yield header("panel's FWHM, pixels", "model", "optimizer", *(f"to {share:g}" for share in SHARES))
    case = cases()[1]
    A, start = pp.Projector(case.views, case.grid), np.full(case.grid.shape, 0.02, np.float32)
    for pixels in (1, 3):
        blur = pp.Blur(panel=pixels * case.views.panels[0].pitch[0])
        scan = replace(replace(case, blur=blur).scan(speck=True, seed=SEED), blur=blur)
        prior = pp.Prior("quadratic")
        beta = 0.3 * median_curvature(data_curvature(A, Transmission.of(scan)))
        for name, likelihood in (("without", Transmission.of), ("blur", pp.Blurred.of)):
            data: Likelihood = likelihood(scan)
            runs = optimizers(A, data, prior, beta, start, lambda views, s=scan, of=likelihood: of(s[views]))
            first = Problem(A, data, prior, beta, "optimal").objective(start)
            least = min(objective for _, objective in islice(runs["momentum"](), ENOUGH))
            for optimizer, run in runs.items():
                gap = (np.array([objective for _, objective in islice(run(), MOST)]) - least) / (first - least)
                cells = [str(np.argmax(gap < s) + 1) if (gap < s).any() else f"over {MOST}" for s in SHARES]
                yield row(pixels, name, optimizer, *cells)


def optimizers(
    A: pp.Projector,
    data: Likelihood,
    prior: pp.Prior,
    beta: float,
    start: Float32,
    part: Callable[[list[int]], Likelihood],
) -> dict[str, Callable[[], Iterator[tuple[Float32, float]]]]:
    """Runs by name."""
    return {
        "momentum": lambda: memory_gradient(A, data, prior, beta, start),
        "auto": lambda: hybrid_descent(A, data, prior, beta, start),
        "subsets": lambda: ordered_subsets(A, data, prior, beta, start, part),
        "descent": lambda: coordinate_descent(A, data, prior, beta, start),
        "EM descent": lambda: coordinate_descent(A, data, prior, beta, start, "optimal"),
    }


def cost_lines() -> Iterator[str]:
    """The table of times."""
    yield header("scan", "FWHM, pixels", "iteration: with / without", "sweep: with / without")
    for name in ["W1 circular-8"]:
        views, grid = WORKLOADS[name]()
        A, start = pp.Projector(views, grid), (0.02 * smooth(grid)).astype(np.float32)
        bare = pp.Scan(np.full(views.shape, 900, np.float32), 2e3, views, 10)
        for pixels in (1, 3):
            scan = replace(bare, blur=pp.Blur(panel=pixels * views.panels[0].pitch[0]))
            beta, works = 100.0, {}
            for model, data in (("without", Transmission.of(scan)), ("with", pp.Blurred.of(scan))):
                for work, optimizer in (("iteration", memory_gradient), ("sweep", coordinate_descent)):
                    run = optimizer(A, data, pp.Prior("quadratic"), beta, start)
                    next(run)
                    works[f"{work} {model}"] = lambda run=run: next(run)
            took = medians(works, repeats=3, warm=False)
            ratios = [took[f"{work} with"].cpu / took[f"{work} without"].cpu for work in ("iteration", "sweep")]
            yield row(name, pixels, *(f"{ratio:.2f}" for ratio in ratios))


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blur", description=__doc__)
    parser.add_argument("tables", nargs="*", default=["image", "convergence", "cost"])
    parser.add_argument("--plot", help="picture of the profiles")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    for table in chosen.tables:
        lines = {"image": lambda: image_lines(chosen.plot), "convergence": convergence_lines, "cost": cost_lines}[
            table
        ]()
        for line in lines:
            print(line, flush=True)
        print()


if __name__ == "__main__":
    main()
