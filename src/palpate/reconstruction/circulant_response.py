"""The local impulse response by Fourier transforms, as if the data weighed alike at all places of a slice."""

import math
from collections.abc import Callable

import numpy as np
import scipy.fft

from palpate.arrays import Float32, Float64
from palpate.errors import GeometryError
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.scans.blur import Blur
from palpate.scans.views import Views
from palpate.volumes.grid import Grid

FLATTEST = 0.2  # cosine between ray and the slices' normal: a flatter ray leaves the window within few slices
FAINT = 1e-3  # an alias weaker than this share of the strongest is left out
FLOOR = 1e-5  # share of F_jj that is added to F, since neither F nor R sees a constant difference between all voxels


class CirculantResponse:
    """F and R of a window as matrices over its slices, one for each frequency (ky, kx) in the slice.

    A view at the angle t (shift in the slice per depth) shows a voxel as a shadow whose spectrum is a(k), and
    F(z, z') = Σ over views of a(k)² exp(−i k·t (z − z')), with its aliases: voxels sample the shadow, and pixels lie
    anywhere under it. So depth is exact, with its ends, and only the place within the slice is taken for alike. A blur of the
    view multiplies a(k).

    Attributes
    ----------
    information : float
        F_jj without blur, mm², which β is a multiple of.

    References
    ----------
    Fessler & Rogers, IEEE Trans. Image Process. 5 (1996) 1346. Stayman & Fessler, IEEE TMI 19 (2000) 601.
    """

    def __init__(self, prior: Prior, views: Views, grid: Grid, blur: Blur | None = None) -> None:
        nz, *self.side = grid.shape
        dz, hy, hx = grid.spacing
        self.middle = nz // 2
        kx: Float64 = 2 * np.pi * np.asarray(np.fft.rfftfreq(self.side[1], hx), np.float64)
        ky: Float64 = 2 * np.pi * np.asarray(np.fft.fftfreq(self.side[0], hy), np.float64)[:, None]
        frequencies = len(ky), len(kx)
        lags = np.zeros((nz, *frequencies), np.complex64)  # F(z + lag, z)
        point = np.zeros((2 * nz - 1, *frequencies), np.complex64)  # Aᵀ of a point's shadow, from -nz + 1 slices up
        sharp = np.zeros(frequencies, np.float32)  # F(z, z) without blur
        each = [(*view, y, x) for view in shadows(views, grid, blur) for y in (0, -1, 1) for x in (0, -1, 1)]
        for (down, across), (tx, ty), long, dense, taps, my, mx in each:
            x, y = kx + 2 * np.pi * mx / hx, ky + 2 * np.pi * my / hy
            along = x * tx + y * ty
            phases = x * down[0] + y * down[1], x * across[0] + y * across[1]
            pixel = _box(phases[0]) * _box(phases[1])
            shadow = pixel * _box(x * hx) * _box(y * hy) * _box(along * dz)
            weight = dense * long**2 * dz * shadow
            if np.abs(weight * shadow).max() < FAINT * dense * long**2 * dz:
                continue
            sharp += weight * shadow * dz * hx * hy
            for kernel, phase in zip(taps, phases, strict=True):
                weight = weight * _spectrum(kernel, phase) ** 2
            step = np.exp(-1j * along * dz).astype(np.complex64)
            turn = np.ones_like(step)
            for lag in range(nz):
                lags[lag] += (weight * shadow * dz * hx * hy) * turn
                point[nz - 1 + lag] += weight * pixel * turn
                if lag:
                    point[nz - 1 - lag] += weight * pixel * turn.conj()
                turn *= step
        self.information = _mean(sharp, self.side[1])
        difference = np.subtract.outer(np.arange(nz), np.arange(nz))
        both = np.concatenate([lags[:0:-1].conj(), lags])
        F = np.moveaxis(both[difference + nz - 1], (0, 1), (2, 3))
        self.data = F + np.complex64(FLOOR * self.information) * np.eye(nz, dtype=np.float32)
        self.load = np.moveaxis(point[nz - 1 - self.middle :][:nz], 0, 2)[..., None].copy()
        self.penalty = self.information * _prior_matrices(prior, grid, kx, ky)

    def middle_slice(self, strength: float) -> Float64:
        """(y, x) of the response to a point in the middle."""
        l = np.linalg.solve(self.data + np.float32(strength) * self.penalty, self.load)[..., self.middle, 0]
        return np.fft.fftshift(np.fft.irfft2(l, s=self.side))

    def noise(self, strength: float) -> float:
        """Standard deviation of a voxel in the middle for rays of variance 1: (F + β R)⁻¹ F (F + β R)⁻¹ is the covariance."""
        unit = np.zeros((self.data.shape[-1], 1), np.float32)
        unit[self.middle] = 1
        column = np.linalg.solve(self.data + np.float32(strength) * self.penalty, unit)
        variance = (np.conj(column) * (self.data @ column)).sum(axis=(2, 3)).real
        return math.sqrt(_mean(variance, self.side[1]))

    def inverse(self, strength: float) -> Callable[[Float32], Float32]:
        """(F + β R)⁻¹, to be applied to a volume."""
        matrices = np.linalg.inv(self.data + np.float32(strength) * self.penalty)

        def apply(volume: Float32) -> Float32:
            spectrum = np.moveaxis(scipy.fft.rfft2(volume), 0, 2)[..., None]
            solved = np.moveaxis((matrices @ spectrum)[..., 0], 2, 0)
            return np.asarray(scipy.fft.irfft2(solved, s=volume.shape[1:]), dtype=np.float32)

        return apply


def shadows(views: Views, grid: Grid, blur: Blur | None = None) -> list[tuple[Float64, Float64, float, float, Float32]]:
    """Of each view at the grid's middle: the two sides (x, y) of a pixel's shadow in the slice, mm; the ray's shift (x, y)
    per depth; the ray's length per depth; pixels per mm² of the slice; the blur's kernels across rows and columns, see
    `Blur.taps`. Views whose rays are flat are left out."""
    middle = grid.bounds.mean(axis=0)
    step = 0.01 * min(grid.spacing)
    landed = views.project(middle + step * np.concatenate([np.zeros((1, 3)), np.eye(3)]))
    moved = np.moveaxis(landed[:, 1:] - landed[:, :1], 1, 2) / step  # (views, (row, column), (x, y, z)), pixels per mm
    rays = middle - views.source
    long = np.linalg.norm(rays, axis=1) / np.maximum(np.abs(rays[:, 2]), 1e-9)
    taps = np.ones((len(views), 2, 1), np.float32) if blur is None else blur.taps(views)
    steep = [
        (m, np.linalg.inv(m[:, :2]), float(l), t) for m, l, t in zip(moved, long, taps, strict=True) if l < 1 / FLATTEST
    ]
    if not steep:
        raise GeometryError("prior resolution: all rays are nearly parallel to the slices; give a strength instead")
    return [(side.T, -side @ m[:, 2], l, abs(float(np.linalg.det(m[:, :2]))), t) for m, side, l, t in steep]


def _prior_matrices(prior: Prior, grid: Grid, kx: Float64, ky: Float64) -> Float32:
    """R for each frequency, (ky, kx, z, z)."""
    nz, (_, hy, hx) = grid.shape[0], grid.spacing
    one = np.zeros((3, 3, 3), np.float32)
    one[1, 1, 1] = 1
    around = prior.surrogate(one, Grid(one.shape, grid.spacing))[0]  # a column of R
    above, same = (
        sum(w * np.cos(kx * hx * (x - 1) + ky * hy * (y - 1)) for (y, x), w in np.ndenumerate(around[z]))
        for z in (0, 1)
    )
    z = np.arange(nz)
    R = np.zeros((len(ky), len(kx), nz, nz), np.float32)
    # The first and last slice have neighbours on one side only.
    R[..., z, z] = same[..., None] + around[0].sum() * (np.float32(z == 0) + np.float32(z == nz - 1))
    R[..., z[1:], z[:-1]] = R[..., z[:-1], z[1:]] = above[..., None]
    return R


def _box(phase: Float64) -> Float64:
    """Spectrum of a box of area 1; phase: frequency times width."""
    return np.asarray(np.sinc(phase / (2 * math.pi)))


def _spectrum(taps: Float32, phase: Float64) -> Float64:
    """Of a symmetric kernel on pixels, given from its middle outwards; phase: of one pixel."""
    sides = sum((2 * tap * np.cos(n * phase) for n, tap in enumerate(taps[1:].tolist(), 1)), np.zeros(()))
    return np.asarray(float(taps[0]) + sides)


def _mean(half: Float32, columns: int) -> float:
    """Mean over all frequencies of what is known for the half of `rfft`."""
    twice = np.full(half.shape[1], 2.0)
    twice[0] = 1
    if columns % 2 == 0:
        twice[-1] = 1
    return float((half * twice).sum() / (half.shape[0] * columns))
