"""The one breast that the report shows: its slice through the lump, and its force map with the band."""

import numpy as np

from palpate.arrays import AnyArray, Float32
from palpate.reconstruction.posterior import Posterior
from palpate.reconstruction.region_of_interest import average_onto
from palpate.studies.doubt.bodies import random_body
from palpate.studies.doubt.config import Setting
from palpate.studies.doubt.run import ITERATIONS, Record, sampled, samples_of
from palpate.tissue.lump_uncertainty import LumpUncertainty
from palpate.volumes.volume import Volume

ALONG = 17  # places of the force map, on a line over the lump
REACH = 24.0  # mm to either side
MORE = ITERATIONS, 10, 40  # iterations of a sample
ENDS = 0.05, 0.5, 0.95  # quantiles of the band


def shown_breast(setting: Setting) -> Record:
    """Of the first breast that judges: "truth" and "map", the slices through the lump, 1/mm; "centre" and "radius", mm.

    And along a line over the lump: "x", mm from the place that is pushed, and "band", (3, places), quantiles of the added
    force over that without the lump.
    """
    seed = setting.train
    body = random_body(seed, setting)
    found = sampled(body, seed, setting)
    first, ball = samples_of(found, body.mark, seed, setting)
    x = np.linspace(-REACH, REACH, ALONG)
    low, high = setting.kind.across * np.array([-0.6, 0.6])
    x = x[(first.point[0] + x > low) & (first.point[0] + x < high)]
    places = first.point + x[:, None] * np.array([1.0, 0.0, 0.0])
    doubt, _ = samples_of(found, body.mark, seed, setting, places)
    grid = found.map.grid
    at = int(np.argmin(np.abs(grid.axis("z") - body.centre[2])))
    truth = average_onto(Volume(body.values, body.breast.grid), grid)
    record: Record = {
        "truth": truth[at],
        "map": found.map.values[at],
        "std": found.std.values[at],
        "centre": np.array(ball.centre),
        "radius": np.array(ball.radius),
        "true centre": body.centre,
        "true radii": body.radii,
        "x": x,
    }
    return record | band_of(doubt) | converging(found, first.weights, setting)


def converging(found: Posterior, weights: Float32, setting: Setting) -> Record:
    """ "ratios" of the contrast's standard deviation by samples of so many "iterations" to that of first order."""
    first_order, count = found.linear_std(weights), 2 * setting.samples
    ratios = []
    for iterations in MORE:
        drawn = [float(np.vdot(weights, found.laplace.draw(setting.train, k, iterations))) for k in range(count)]
        ratios.append(float(np.std(drawn, ddof=1)) / first_order)
    return {"iterations": np.array(MORE), "ratios": np.array(ratios), "converged samples": np.array(count)}


def band_of(doubt: LumpUncertainty) -> dict[str, AnyArray]:
    """Quantiles of the added force over that without the lump, at each place."""
    return {"band": np.quantile(doubt.forces / doubt.plain_forces - 1, ENDS, axis=0, method="weibull")}
