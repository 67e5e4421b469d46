"""Who reconstructs: what is judged, two more of ours, and its rivals, each in all its settings."""

from collections.abc import Iterator
from itertools import islice

import numpy as np

from palpate.arrays import Float32
from palpate.reconstruction.baselines.filtered_backprojection import fbp
from palpate.reconstruction.baselines.sart import sart
from palpate.reconstruction.baselines.sirt import sirt
from palpate.reconstruction.baselines.total_variation import tv
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.reconstruct import reconstruct
from palpate.scans.scan import Scan
from palpate.studies.detection.config import WIDTH
from palpate.studies.rtk_reference import installed, rtk_sart
from palpate.volumes.grid import Grid

JUDGED, NO_HULL, EDGES = "MAP by resolution, hull", "MAP by resolution", "MAP for smooth objects"
OURS = JUDGED, NO_HULL, EDGES
SART_PASSES, SIRT_ITERATIONS = (1, 2, 3), (5, 10, 20, 40)
CUTOFFS = (1.0, 0.6)
STRENGTHS = (0.0001, 0.0005)  # of total variation, from the first pass of SART
TV_ITERATIONS = 15


def images(scan: Scan, grid: Grid) -> Iterator[tuple[str, Float32]]:
    """(method, candidate) and its image, (z, y, x): ours first, then the rivals, each in all its settings."""
    prior = Prior("quadratic", resolution=WIDTH * grid.spacing[2])
    yield JUDGED, reconstruct(scan, grid, prior=prior, support="hull").values
    yield NO_HULL, reconstruct(scan, grid, prior=prior).values
    yield EDGES, reconstruct(scan, grid).values
    A, data = Projector(scan.views, grid), Transmission.of(scan)
    empty = np.zeros(grid.shape, np.float32)
    passes = [values.copy() for values, _ in islice(sart(A, data, empty), SART_PASSES[-1])]
    for n in SART_PASSES:
        yield f"SART, {n} pass{'es' * (n > 1)}", passes[n - 1]
    for n, (values, _) in enumerate(islice(sirt(A, data, empty), SIRT_ITERATIONS[-1]), 1):
        if n in SIRT_ITERATIONS:
            yield f"SIRT, {n} iterations", values
    for cutoff in CUTOFFS:
        yield f"FBP, cutoff {cutoff:g}", fbp(A, data, "hann", cutoff)
    for strength in STRENGTHS:
        *_, (values, _) = islice(tv(A, data, passes[0], strength), TV_ITERATIONS)
        yield f"TV, strength {strength:g}", values
    if installed():
        values = empty
        for n in SART_PASSES:
            values = rtk_sart(scan, grid, 1, values)
            yield f"RTK SART, {n} pass{'es' * (n > 1)}", values
