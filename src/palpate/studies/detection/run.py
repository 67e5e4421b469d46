"""One breast through everything: scanned with signals and without, reconstructed by all, seen by the observers."""

from collections.abc import Callable, Iterator

import numpy as np

from palpate.arrays import AnyArray, Bool, Float32, Float64
from palpate.reconstruction.region_of_interest import average_onto
from palpate.scans.intensity_correction import line_integrals
from palpate.studies.detection.acquisition import effective_attenuation, expose, noise, path_lengths
from palpate.studies.detection.breast import Breast, random_breast
from palpate.studies.detection.config import CALCIFICATION, MASS, Kind, Setting
from palpate.studies.detection.methods import images
from palpate.studies.detection.observers import OBSERVERS, Observer, image_channels, projection_channels
from palpate.studies.detection.signals import Signals, places_without_signal, random_signals
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

PROJECTIONS = "projections"  # what an observer sees without any reconstruction: a reference, no method
FREE = "free"
Record = dict[str, AnyArray]  # by "dose|method|what|state", see `scan_breast`


def scan_breast(kind: Kind, seed: int, setting: Setting, scatter: Float32, tell: Callable[[float], None]) -> Record:
    """All that is judged of one breast. scatter: of `scatter_of`. tell: told the share that is done.

    Of each dose and method: channels of the places of each size, "present" and "absent", and of places that never have a
    signal, "free", by observer; and "rmse" of the image without signals, 1/mm.
    """
    breast, signals, free = random_case(kind, seed, setting)
    views, grid = setting.views(kind), setting.grid(kind)
    truth, inside = true_image(breast, kind, grid)
    lengths = path_lengths(breast, views)
    exposures = {"present": expose(lengths, scatter, views, signals), "absent": expose(lengths, scatter, views, None)}
    found: Record = {}
    for n, dose in enumerate(setting.doses):
        normal = np.random.default_rng([seed, dose]).standard_normal(scatter.shape, dtype=np.float32)
        for m, (state, exposure) in enumerate(exposures.items()):
            scan, look = noise(exposure, dose, kind.thick, normal), list(_places(signals, free, state))
            lines = line_integrals(scan)
            for what, observer, places in look:
                found[f"{dose}|{PROJECTIONS}|{what}"] = projection_channels(lines, views, places, observer)
            for name, values in images(scan, grid):
                for what, observer, places in look:
                    found[f"{dose}|{name}|{what}"] = image_channels(values, grid, places, observer)
                if state == "absent":
                    found[f"{dose}|{name}|rmse"] = np.sqrt(np.mean(np.square((values - truth)[inside], dtype=float)))
            tell((2 * n + m + 1) / (2 * len(setting.doses)))
    return found


def random_case(kind: Kind, seed: int, setting: Setting) -> tuple[Breast, Signals, Float64]:
    """A breast, its signals, and (n, 3) mm places that have none; all of a seed."""
    rng = np.random.default_rng([seed, *kind.name.encode()])
    breast = random_breast(kind, setting.fine, rng)
    signals = random_signals(breast, setting, rng)
    return breast, signals, places_without_signal(breast, setting, rng)


def true_image(breast: Breast, kind: Kind, grid: Grid) -> tuple[Float32, Bool]:
    """The attenuation that a gray image should show, means over voxels, 1/mm; and the voxels wholly in the breast."""
    mu = effective_attenuation(kind)
    fat, gland = mu["adipose"], mu["glandular"]
    values = breast.tissue * (np.float32(fat) + np.float32(gland - fat) * breast.gland)
    inside = average_onto(Volume(breast.tissue, breast.grid), grid) > 0.999
    return average_onto(Volume(values, breast.grid), grid), inside


def _places(signals: Signals, free: Float64, state: str) -> Iterator[tuple[str, Observer, Float64]]:
    """What is looked at: its name, by which observer, where."""
    sizes = np.array(signals.size)
    for size in dict.fromkeys(signals.size):
        observer = OBSERVERS[MASS if size == MASS else CALCIFICATION]
        yield f"{size}|{state}", observer, signals.centre[sizes == size]
    if state == "absent":
        for what, observer in OBSERVERS.items():
            yield f"{what}|{FREE}", observer, free
