"""The geometries that are measured. Lengths in mm; slices 1 mm thick unless said otherwise."""

from collections.abc import Callable

import numpy as np

import palpate as pp

Workload = tuple[pp.Views, pp.Grid]


def circular(snap: float = 0.0) -> Workload:
    """W1: 8 sources on a circle of radius 250, 1000 above a 512x512 panel; 256x256x48 voxels of 0.5.

    snap: puts the sources on multiples of it, for a peer whose panel must follow the source by whole pixels.
    """
    a = np.arange(8) * np.pi / 4
    source = np.stack([250 * np.cos(a), 250 * np.sin(a), 0 * a + 1000], axis=1)
    if snap:
        source[:, :2] = np.round(source[:, :2] / snap) * snap
    panel = pp.Panel((512, 512), (0.4, 0.4), (-102.2, -102.2, 0))
    return pp.Views(source, panel), pp.Grid((48, 256, 256), (1, 0.5, 0.5), (-63.75, -63.75, 30.5))


def coarse_circular() -> Workload:
    """W1 in cubic voxels of 2 and pixels of 1.6: a 64th of the work, for a peer that would take hours."""
    views, _ = circular(snap=1.6)
    return pp.Views(views.source, pp.Panel((128, 128), (1.6, 1.6), (-101.6, -101.6, 0))), pp.Grid(
        (24, 64, 64), (2, 2, 2), (-63, -63, 31)
    )


def _arc(count: int, panel: pp.Panel) -> pp.Views:
    """±25° on a radius of 650 about z = 40, the sources above the chest wall y = 0."""
    a = np.radians(np.linspace(-25, 25, count))
    return pp.Views(np.stack([650 * np.sin(a), 0 * a, 40 + 650 * np.cos(a)], axis=1), panel)


def breast() -> Workload:
    """W2: 15 sources on the arc, 1024x768 panel of 0.17; 800x512x50 voxels of 0.2."""
    views = _arc(15, pp.Panel((768, 1024), (0.17, 0.17), (-86.955, 0.085, 0)))
    return views, pp.Grid((50, 512, 800), (1, 0.2, 0.2), (-79.9, 0.1, 30.5))


def clinical() -> Workload:
    """W3: 25 sources on the arc, 2048x1536 panel of 0.14; 1600x1024x60 voxels of 0.16."""
    views = _arc(25, pp.Panel((1536, 2048), (0.14, 0.14), (-143.29, 0.07, 0)))
    return views, pp.Grid((60, 1024, 1600), (1, 0.16, 0.16), (-127.92, 0.08, 30.5))


def turning() -> Workload:
    """W4: 11 views of a head by a panel that turns with the source, 5 mm slices."""
    a = np.radians(np.arange(-20, 21, 4))
    source = np.stack([1000 * np.sin(a), 0 * a, 1000 * np.cos(a)], axis=1)
    panels = []
    for s, t in zip(source, a, strict=True):
        column_axis = np.array([np.cos(t), 0, -np.sin(t)])
        corner = -s / 2 - 255.5 * 0.78125 * (column_axis + [0, 1, 0])
        panels.append(pp.Panel((512, 512), (0.78125, 0.78125), corner, (0, 1, 0), column_axis))
    return pp.Views(source, panels), pp.Grid((50, 300, 300), (5, 1, 1), (-149.5, -149.5, -122.5))


def diagonal() -> Workload:
    """W5: 4 sources 25° off in both axes at once, W2's panel pitch and voxels."""
    source = [(x, y, 690.0) for x in (-303.0, 303.0) for y in (-303.0, 303.0)]
    panel = pp.Panel((768, 768), (0.17, 0.17), (-65.195, -65.195, 0))
    return pp.Views(source, panel), pp.Grid((50, 400, 400), (1, 0.2, 0.2), (-39.9, -39.9, 30.5))


WORKLOADS: dict[str, Callable[[], Workload]] = {
    "W1 circular-8": circular,
    "W2 dbt-15": breast,
    "W3 clinical-25": clinical,
    "W4 turning-11": turning,
    "W5 diagonal-4": diagonal,
}


def smooth(grid: pp.Grid) -> np.ndarray:
    """(z, y, x): one broad hump with waves on it, not its own mirror image, 0 at the grid's faces."""
    t = [(np.arange(n) + 0.5) / n for n in grid.shape]
    hump = [np.sin(np.pi * a) ** 2 for a in t]
    waves = [1 + 0.3 * np.cos(2 * np.pi * k * a + 1) for k, a in zip((2, 5, 7), t, strict=True)]
    z, y, x = (h * w for h, w in zip(hump, waves, strict=True))
    return (0.05 * z[:, None, None] * y[:, None] * x).astype(np.float32)
