"""The one breast that the report shows: its slice through the lump, and its force map with the band."""

import numpy as np

from palpate.arrays import AnyArray, Float32
from palpate.reconstruction.posterior import Posterior
from palpate.reconstruction.region_of_interest import average_onto
from palpate.studies.doubt.bodies import random_body
from palpate.studies.doubt.config import Setting
from palpate.studies.doubt.run import Record, sampled, samples_of
from palpate.tissue.lump_uncertainty import LumpUncertainty
from palpate.volumes.volume import Volume

ALONG = 17  # places of the force map, on a line over the lump
REACH = 24.0  # mm to either side
ENDS = 0.05, 0.5, 0.95  # quantiles of the band


def shown_breast(setting: Setting) -> Record:
    """Of the first breast that judges: "truth" and "map", the slices through the lump, 1/mm; "centre" and "radius", mm.

    And along a line over the lump: "x", mm from the place that is pushed, and "band", (3, places), quantiles of the added
    force over that without the lump.
    """
    seed = setting.train
    body = random_body(seed, setting)
    found = sampled(body, seed, setting)
    # At most to where the upper plate still touches the breast.
    reach = 0.6 * setting.kind.across
    x = np.linspace(-REACH, REACH, ALONG)
    x = x[np.abs(body.centre[0] + x) < reach]
    doubt, ball = samples_of(found, body.mark, seed, setting, x[:, None] * np.array([1.0, 0.0, 0.0]))
    grid = found.map.grid
    at = int(np.argmin(np.abs(grid.axis("z") - body.centre[2])))
    truth = average_onto(Volume(body.values, body.breast.grid), grid)
    record: Record = {
        "truth": truth[at],
        "map": found.map.values[at],
        "centre": np.array(ball.centre),
        "radius": np.array(ball.radius),
        "true centre": body.centre,
        "true radii": body.radii,
        "x": x,
    }
    return record | band_of(doubt) | converging(found, doubt.weights, setting)


def converging(found: Posterior, weights: Float32, setting: Setting) -> Record:
    """The contrast's standard deviation by samples over that of first order, "ratios", by "iterations" of a sample."""
    first_order, count = found.linear_std(weights), 2 * setting.samples
    ratios = []
    for iterations in setting.iterations:
        drawn = [float(np.vdot(weights, found.laplace.draw(setting.train, k, iterations))) for k in range(count)]
        ratios.append(float(np.std(drawn, ddof=1)) / first_order)
    return {
        "iterations": np.array(setting.iterations),
        "ratios": np.array(ratios),
        "converged samples": np.array(count),
    }


def band_of(doubt: LumpUncertainty) -> dict[str, AnyArray]:
    """Quantiles of the added force over that without the lump, at each place."""
    return {"band": np.quantile(doubt.forces / doubt.plain_forces - 1, ENDS, axis=0, method="weibull")}
