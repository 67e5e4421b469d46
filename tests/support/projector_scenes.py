"""Views and grids on which the projector is judged: of the dissertation's scans, skew ones, and small ones."""

import numpy as np
import pytest

import palpate as pp
from palpate import _core


def turned(normal_tilt, azimuth, spin):
    """Row and column axes of a panel tilted by one angle towards an azimuth and spun in its plane, radians."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    around_z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    c, s = np.cos(normal_tilt), np.sin(normal_tilt)
    around_y = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    turn = around_z @ around_y @ around_z.T
    c, s = np.cos(spin), np.sin(spin)
    return turn @ [-s, c, 0], turn @ [c, s, 0]


def centred(shape, pitch, middle, row_axis, column_axis):
    """A panel by its middle."""
    rows, columns = (np.array(shape) - 1) / 2 * np.array(pitch)
    origin = np.asarray(middle) - rows * np.asarray(row_axis) - columns * np.asarray(column_axis)
    return pp.Panel(shape, pitch, origin, row_axis, column_axis)


def circular():
    a = np.arange(8) * np.pi / 4
    source = np.stack([250 * np.cos(a), 250 * np.sin(a), 0 * a + 1000], axis=1)
    panel = pp.Panel((512, 512), (0.4, 0.4), (-102.2, -102.2, 0))
    return pp.Views(source, panel), pp.Grid((48, 256, 256), (1, 0.5, 0.5), (-63.75, -63.75, 30.5)), 5e-3


def breast():
    a = np.radians([-15, -10, -5, 0, 5, 10, 15])
    source = np.stack([-605 * np.sin(a), 0 * a, 605 * np.cos(a)], axis=1)
    panel = pp.Panel((615, 170), (0.4, 0.4), (-122.8, 0.2, -45), row_axis=(1, 0, 0), column_axis=(0, 1, 0))
    return pp.Views(source, panel), pp.Grid((64, 156, 504), (0.8, 0.4, 0.4), (-100.6, 0.2, -44.6)), 5e-3


def long_breast():
    """Fine voxels in thick slices, from the chest wall, above which the sources are, to far off it on either side."""
    a = np.radians([-25, 8, 23])
    source = np.stack([650 * np.sin(a), 0 * a, 40 + 650 * np.cos(a)], axis=1)
    panel = pp.Panel((730, 560), (0.13, 0.13), (-36.4, 0.065, 0))
    return pp.Views(source, panel), pp.Grid((5, 850, 210), (1, 0.1, 0.1), (-10.45, 0.05, 58.5)), 5e-3


def head():
    a = np.radians(np.arange(-20, 21, 4))
    source = np.stack([1000 * np.sin(a), 0 * a, 1000 * np.cos(a)], axis=1)
    panels = [
        centred((512, 512), (0.78125, 0.78125), -s / 2, (0, 1, 0), (np.cos(t), 0, -np.sin(t)))
        for s, t in zip(source, a, strict=True)
    ]
    return pp.Views(source, panels), pp.Grid((50, 300, 300), (5, 1, 1), (-149.5, -149.5, -122.5)), 1e-2


def skew():
    """Panels tilted and spun every way, a grid that reaches beyond them."""
    source = [(120, -90, 600), (-200, 150, 500), (0, 10, 700)]
    poses = [(0.3, 0.7, 0.4), (0.5, -2.0, 1.2), (0.0, 0.0, np.pi / 4)]
    panels = [centred((300, 260), (0.5, 0.6), (0, 5, -60), *turned(*pose)) for pose in poses]
    return pp.Views(source, panels), pp.Grid((60, 160, 190), (1.2, 0.8, 0.9), (-85, -64, -20)), 1e-2


def about_either_axis():
    """Panels turned about y and about x, rows and columns exchanged and mirrored."""
    source = [(200, 40, 560), (-60, -180, 600)]
    poses = [(0.4, 0.0, np.pi), (-0.35, np.pi / 2, np.pi / 2)]
    panels = [centred((310, 290), (0.5, 0.6), (-60, 20, -70), *turned(*pose)) for pose in poses]
    return pp.Views(source, panels), pp.Grid((60, 160, 190), (1.2, 0.8, 0.9), (-85, -64, -20)), 5e-3


def finer_pixels():
    """Sources off both axes, voxels of one and a half pixels, slices that cast shadows of several."""
    views, _grid, tolerance = circular()
    views = pp.Views(views.source[1:4] * (1.6, 1.6, 0.8), pp.Panel((390, 410), (0.35, 0.3), (-75, -60, 0)))
    return views, pp.Grid((9, 131, 147), (2, 0.5, 0.45), (-31, -40, 30.5)), tolerance


def small(**changes):
    at = dict(shape=(12, 14), pitch=(1.5, 1.25), origin=(-8.0, -8.0, 0.0))
    return pp.Views([(9, 7, 80), (-15, 4, 90)], pp.Panel(**(at | changes))), pp.Grid((3, 5, 7), (2, 1, 1), (-3, -2, 10))


def noise(grid, seed=0):
    return np.random.default_rng(seed).random(grid.shape, dtype=np.float32)


@pytest.fixture(scope="module", autouse=True)
def several_threads():
    _core.base.set_threads(2)
    yield
    _core.base.set_threads(0)
