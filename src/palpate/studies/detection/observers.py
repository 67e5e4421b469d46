"""Model observers: channels at a known place, and the best linear weights of them (Hotelling).

Channels: Laguerre-Gauss across (Gallas & Barrett, J. Opt. Soc. Am. A 20:1725, 2003) times Gaussians in depth.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import eval_laguerre
from scipy.stats import norm

from palpate.arrays import AnyArray, Float32, Float64
from palpate.scans.views import Views
from palpate.studies.detection.config import CALCIFICATION, MASS
from palpate.volumes.grid import Grid

AT_ONCE = 256  # places


@dataclass(frozen=True)
class Observer:
    """width: of the channels across, mm. orders: of Laguerre's polynomials. depths: deviations of the Gaussians, mm."""

    width: float
    orders: int
    depths: tuple[float, ...]


OBSERVERS = {MASS: Observer(6.0, 6, (1.5, 5.0)), CALCIFICATION: Observer(1.4, 5, (0.7, 3.0))}


def image_channels(values: AnyArray, grid: Grid, places: Float64, observer: Observer) -> Float32:
    """(places, channels): the image seen through the channels about each place (x, y, z), mm."""
    reach = (2 * max(observer.depths), *(1.2 * observer.width,) * 2)
    around = [
        np.arange(-int(np.ceil(r / d)), int(np.ceil(r / d)) + 1) for r, d in zip(reach, grid.spacing, strict=True)
    ]
    found = []
    for some in _some(places):
        near = np.round((some - grid.origin) / grid.spacing[::-1]).astype(int)[:, ::-1]
        index = [
            np.clip(near[:, k, None] + a, 0, n - 1) for k, (a, n) in enumerate(zip(around, grid.shape, strict=True))
        ]
        z, y, x = (
            (near[:, k, None] + around[k]) * grid.spacing[k] + grid.origin[2 - k] - some[:, 2 - k, None]
            for k in range(3)
        )
        patch = values[index[0][:, :, None, None], index[1][:, None, :, None], index[2][:, None, None, :]]
        across = laguerre_gauss(y[:, :, None] ** 2 + x[:, None, :] ** 2, observer)
        deep = np.stack([np.exp(-((z / s) ** 2) / 2) for s in observer.depths])
        deep /= deep.sum(axis=2, keepdims=True)
        slices = np.einsum("pzyx,dpz->pdyx", patch, deep, optimize=True)
        seen = np.einsum("pdyx,opyx->pdo", slices, across, optimize=True)
        found.append(seen.reshape(len(some), -1) * grid.spacing[1] * grid.spacing[2])
    return np.concatenate(found).astype(np.float32)


def projection_channels(lines: AnyArray, views: Views, places: Float64, observer: Observer) -> Float32:
    """(places, views * orders): the measured line integrals through channels about the shadow of each place."""
    found = []
    for k, panel in enumerate(views.panels):
        reach = [int(np.ceil(1.2 * observer.width / p)) for p in panel.pitch]
        seen = []
        for some in _some(places):
            landed = views[k].project(some)[0]
            near = np.round(landed).astype(int)
            at = [near[:, i, None] + np.arange(-reach[i], reach[i] + 1) for i in range(2)]
            v, u = ((at[i] - landed[:, i, None]) * panel.pitch[i] for i in range(2))
            row, column = (np.clip(at[i], 0, panel.shape[i] - 1) for i in range(2))
            patch = lines[k][row[:, :, None], column[:, None, :]]
            across = laguerre_gauss(v[:, :, None] ** 2 + u[:, None, :] ** 2, observer)
            seen.append(np.einsum("pyx,opyx->po", patch, across) * panel.pitch[0] * panel.pitch[1])
        found.append(np.concatenate(seen))
    return np.concatenate(found, axis=1).astype(np.float32)


def laguerre_gauss(square: Float64, observer: Observer) -> Float64:
    """(orders, ...): the channels at squared distances, mm²."""
    t = 2 * np.pi * square / observer.width**2
    return np.stack([np.exp(-t / 2) * eval_laguerre(n, t) for n in range(observer.orders)]) * 2**0.5 / observer.width


def _some(places: Float64) -> Iterator[Float64]:
    for k in range(0, len(places), AT_ONCE):
        yield places[k : k + AT_ONCE]


@dataclass(frozen=True, eq=False)
class Seen:
    """What an observer saw of one breast through its channels: places with a signal, the same without, and free ones."""

    present: Float64
    absent: Float64
    free: Float64


@dataclass(frozen=True, eq=False)
class Scores:
    """The observer's rating of each place of one breast, with a signal and free of any; of those that taught it, free
    places have mean 0 and deviation 1."""

    present: Float64
    free: Float64


def hotelling_scores(breasts: Sequence[Seen], folds: int) -> list[Scores]:
    """Ratings of each breast by weights K⁻¹Δ that other breasts taught: K the covariance of free places, Δ the mean of
    present less absent. The fold is the breast's number, modulo `folds`."""
    found: list[Scores] = []
    for k, own in enumerate(breasts):
        others = [b for n, b in enumerate(breasts) if n % folds != k % folds]
        free = np.concatenate([b.free for b in others])
        gain = np.concatenate([b.present - b.absent for b in others]).mean(axis=0)
        scale = free.std(axis=0)
        covariance = np.cov(free / scale, rowvar=False)
        weights = np.linalg.solve(covariance, gain / scale) / scale
        rated = free @ weights
        middle, spread = rated.mean(), rated.std()
        found.append(Scores(*((values @ weights - middle) / spread for values in (own.present, own.free))))
    return found


def detectability(area: float, pairs: int) -> float:
    """d_A = √2 Φ⁻¹(area under the ROC curve): of normal ratings the distance of their means over the spread.

    Only ranks count, so that no stretching of the ratings changes it. pairs: of ratings that were compared; all in the
    right order count as half a pair that is not.
    """
    return float(np.sqrt(2) * norm.ppf(np.clip(area, 0.5 / pairs, 1 - 0.5 / pairs)))


def roc_areas(scores: Sequence[Scores]) -> Float64:
    """(breasts, breasts): share of pairs in which a signal of the one is rated above a free place of the other."""
    free = [np.sort(s.free) for s in scores]
    return np.array([[np.mean(np.searchsorted(f, s.present)) / len(f) for f in free] for s in scores])


def found_share(scores: Sequence[Scores], false: float) -> float:
    """Share of the signals whose rating is above that of all but a share `false` of the free places."""
    limit = np.quantile(np.concatenate([s.free for s in scores]), 1 - false)
    return float(np.mean(np.concatenate([s.present for s in scores]) > limit))
