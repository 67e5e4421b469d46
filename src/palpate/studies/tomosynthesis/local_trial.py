"""Local tomosynthesis: the region around the ball alone, with and without a model of what lies around it."""

from collections.abc import Mapping

import numpy as np

from palpate.reconstruction.reconstruct import reconstruct
from palpate.reconstruction.region_of_interest import crop_to_region, local_scan, region_grid
from palpate.studies.tomosynthesis.config import REGION
from palpate.studies.tomosynthesis.convergence_traces import ReconstructionProblem
from palpate.studies.tomosynthesis.image_quality import ImageQuality
from palpate.volumes.grid import Grid
from palpate.volumes.image_metrics import nmse
from palpate.volumes.volume import Volume


def local_volumes(problem: ReconstructionProblem) -> dict[str, Volume]:
    """The region out of the full volume; by itself, behind a coarse model of the rest; as if there were no rest."""
    grid, scan = problem.A.grid, problem.scan
    region = region_grid(grid, *REGION)
    whole = reconstruct(scan, grid)
    return {
        "full": cropped(whole, region),
        "local": reconstruct(local_scan(scan, grid, region), region),
        "alone": reconstruct(crop_to_region(scan, region), region),
    }


def local_quality(found: Mapping[str, Volume], image_quality: ImageQuality) -> dict[str, dict[str, float]]:
    """NMSE in the region, as it is and free of window and level, of each volume."""
    out = {}
    for name, volume in found.items():
        truth = cropped(image_quality.truth, volume.grid).values
        full, scaled = nmse(volume.values, truth), nmse(volume.values, truth, scaled=True)
        out[name] = {"nmse": full, "nmse_scaled": scaled}
    return out


def cropped(volume: Volume, region: Grid) -> Volume:
    """The voxels of a volume that are those of a region of its grid."""
    spacing = np.array(volume.grid.spacing[::-1])
    first = np.round((np.array(region.origin) - np.array(volume.grid.origin)) / spacing).astype(int)[::-1]
    part = tuple(slice(a, a + n) for a, n in zip(first, region.shape, strict=True))
    return Volume(np.ascontiguousarray(volume.values[part]), region)
