"""Finds the shadows of dense balls in a view, and where in each the ball's centre lies, to a small part of a pixel.

A ball's shadow is nearly an ellipse, whose centre is not the shadow of the ball's centre. So no centre of gravity is taken:
the exact shadow of the ball (chord lengths along the rays to the pixels) is moved over the image until it fits best. Where
it then puts the ball's centre is the answer.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage, signal

from palpate.arrays import Bool, Float64
from palpate.scans.view_parameters import Poses

CLEAR = 8.0  # standard deviations of a filtered image above which a spot is no noise
SPOTS = 4  # times as many spots as balls are kept, the clearest
FAINT = 0.25  # of the clearest spots' strength: fainter ones are edges of the holder
STEPS = 25  # of Gauss-Newton
SETTLED = 1e-3  # pixels
SURE = 8.0  # standard deviations that a ball's attenuation must exceed 0
RAYS, SMALL = 5, 10.0  # across a pixel, so that the rim of a shadow is right; 3 above SMALL pixels of radius


@dataclass(frozen=True, eq=False)
class Shadows:
    """Centres (N, 2) in fractional row and column, their standard deviations (N, 2) pixels, and which were found (N,)."""

    centres: Float64
    deviations: Float64
    found: Bool


def spots(image: Float64, mask: Bool, radius: float, most: int) -> Float64:
    """(M, 2): row and column of spots about as large as a shadow of `radius` pixels, the clearest first.

    image: line integrals. The filter is the shadow of a ball less the mean of a ring around it.
    """
    filled = np.where(mask, image, np.median(image[mask]))
    r = max(radius, 1.0)
    edge = int(np.ceil(2 * r + 1))
    row, column = np.mgrid[-edge : edge + 1, -edge : edge + 1]
    distance = np.hypot(row, column)
    inner, ring = np.sqrt(np.maximum(1 - (distance / (r + 0.5)) ** 2, 0)), (distance > 1.3 * r + 1) & (distance <= edge)
    kernel = inner / inner.sum() - ring / ring.sum()
    answer = signal.fftconvolve(np.pad(filled, edge, mode="edge"), kernel, mode="valid")
    noise = 1.4826 * np.median(np.abs(answer - np.median(answer)))
    top = answer == ndimage.maximum_filter(answer, size=2 * int(np.ceil(r)) + 1)
    rows, columns = np.nonzero(top & (answer > CLEAR * noise) & mask)
    best = np.argsort(-answer[rows, columns])[: SPOTS * most]
    strength = answer[rows[best], columns[best]]
    if len(best):
        best = best[strength > FAINT * np.median(strength[: (most + 1) // 2])]
    return np.stack([rows[best], columns[best]], axis=1).astype(np.float64)


def centres(
    counts: Float64,
    incident: Float64,
    background: Float64,
    mask: Bool,
    at: Poses,
    view: int,
    balls: Float64,
    radii: Float64,
    expected: Float64,
    start: Float64,
) -> Shadows:
    """Where the shadows of balls' centres lie in one view.

    Fits  counts = incident · exp(−b₀ − b₁v − b₂u) · mean of exp(−μ·chord) + background  around each ball, by weighted least
    squares, for the shift of the shadow, μ and b. The mean is over the pixel.

    counts, incident, background, mask: (rows, columns). balls (N, 3), radii (N,): mm. expected (N, 2): where the poses put
    the centres, pixels. start (N, 2): where the fit begins.
    """
    n = len(balls)
    size = shadow_radii(at, view, balls, radii)
    half, near = _half(size), np.round(start).astype(int)
    inside = apart(at, view, balls, radii, start)
    out = Shadows(np.full((n, 2), np.nan), np.full((n, 2), np.nan), np.zeros(n, bool))
    if not inside.any():
        return out
    these = np.flatnonzero(inside)
    v, u = (g.ravel() for g in np.mgrid[-half : half + 1, -half : half + 1])
    R, C = near[these, :1] + v, near[these, 1:] + u
    use = mask[R, C] & (np.hypot(v, u) <= 1.6 * size[these, None] + 2)
    for j in range(n):  # what another ball darkens tells nothing of this one
        far = np.hypot(R - start[j, 0], C - start[j, 1]) > 1.15 * size[j] + 1.5
        use &= far | (these == j)[:, None]
    y, level, ground = (a[R, C].astype(np.float64) for a in (counts, incident, background))
    model = _ShadowModel(at, view, balls[these], radii[these], expected[these], R, C, v, u, level, ground)
    first = start[these] - expected[these]
    numbers, deviation = _most_likely(model, y, use, _start(model, y, use, first, size[these]), size[these])
    settled = np.hypot(*(numbers[:, :2] - first).T) < 1.5 * size[these]
    sure = (numbers[:, 2] > SURE * deviation[:, 2]) & (deviation[:, :2].max(axis=1) < 0.5)
    whole = use.sum(axis=1) > 0.5 * np.pi * (1.6 * size[these] + 2) ** 2
    out.centres[these], out.deviations[these] = expected[these] + numbers[:, :2], deviation[:, :2]
    out.found[these] = settled & sure & whole
    return out


def shadow_radii(at: Poses, view: int, balls: Float64, radii: Float64) -> Float64:
    """(N,) radius of each shadow, pixels."""
    n = at.axes[view, 2]
    whole, depth = (at.middle[view] - at.source[view]) @ n, (balls - at.source[view]) @ n
    return np.asarray(radii * whole / depth / at.pitch[view].min())


def apart(at: Poses, view: int, balls: Float64, radii: Float64, places: Float64) -> Bool:
    """(N,) which shadows at places (N, 2) are whole on the panel and touch no other."""
    size = shadow_radii(at, view, balls, radii)
    half = _half(size)
    inside = ((places >= half) & (places < np.array(at.shape) - half - 1)).all(axis=1)
    gap = np.linalg.norm(places[:, None] - places[None], axis=2)
    np.fill_diagonal(gap, np.inf)
    return np.asarray(inside & (gap > 1.1 * (size[:, None] + size[None]) + 1).all(axis=1))


def _half(size: Float64) -> int:
    """Half the side of the window around each shadow, pixels."""
    return int(np.ceil(1.6 * size.max() + 3))


class _ShadowModel:
    """Counts around all balls of a view, (N, K), as a function of six numbers each: shift (2), μ, b₀, b₁, b₂."""

    def __init__(
        self,
        at: Poses,
        view: int,
        balls: Float64,
        radii: Float64,
        expected: Float64,
        R: Float64,
        C: Float64,
        v: Float64,
        u: Float64,
        level: Float64,
        ground: Float64,
    ) -> None:
        half = (np.array(at.shape) - 1) / 2
        self.down, self.right = at.axes[view, 0] * at.pitch[view, 0], at.axes[view, 1] * at.pitch[view, 1]
        self.first = at.middle[view] - half[0] * self.down - half[1] * self.right - at.source[view]
        self.to, self.radii, self.expected = balls - at.source[view], radii, expected
        self.R, self.C, self.level, self.ground = R, C, level, ground
        self.ways = np.stack([np.ones(len(v)), v / v.max(), u / u.max()], axis=1)
        rays = RAYS if shadow_radii(at, view, balls, radii).min() < SMALL else 3
        steps = (np.arange(rays) + 0.5) / rays - 0.5
        self.offsets = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)

    def chords(self, R: Float64, C: Float64) -> tuple[Float64, Float64, Float64]:
        """Chord length through each ball along rays to pixels (N, K), mm, and its slopes by row and column.

        With r from the source to the pixel and b to the centre, (chord/2)² = ρ² − |b|² + (b·r)²/(r·r).
        """
        f, d, c, b = self.first, self.down, self.right, self.to
        br = (b @ f)[:, None] + R * (b @ d)[:, None] + C * (b @ c)[:, None]
        rr = f @ f + R * (2 * f @ d) + C * (2 * f @ c) + R * R * (d @ d) + C * C * (c @ c)
        near = br / rr
        q = (self.radii**2 - np.einsum("ni,ni->n", b, b))[:, None] + near * br
        chord = 2 * np.sqrt(np.maximum(q, 0))
        slope = 4 * near * (q > 0) / np.maximum(chord, 0.2 * self.radii[:, None])  # bounded at the rim, where it is not
        by_row = slope * ((b @ d)[:, None] - near * (f @ d + R * (d @ d)))
        by_column = slope * ((b @ c)[:, None] - near * (f @ c + C * (c @ c)))
        return chord, by_row, by_column

    def __call__(self, numbers: Float64) -> tuple[Float64, Float64]:
        """Expected counts (N, K) and their slopes (N, K, 6)."""
        mu, sums = numbers[:, 2, None], np.zeros((4, *self.R.shape))
        for dv, du in self.offsets:
            chord, by_row, by_column = self.chords(self.R + dv - numbers[:, :1], self.C + du - numbers[:, 1:2])
            through = np.exp(-mu * chord)
            for total, term in zip(sums, (1, mu * by_row, mu * by_column, -chord), strict=True):
                total += through * term
        beam = self.level * np.exp(-numbers[:, 3:] @ self.ways.T) / len(self.offsets)
        slopes = [*(beam * total for total in sums[1:]), *(-beam * sums[0] * way for way in self.ways.T)]
        return beam * sums[0] + self.ground, np.stack(slopes, axis=2)


def _start(model: _ShadowModel, y: Float64, use: Bool, shift: Float64, size: Float64) -> Float64:
    """(N, 6): the shift given, background and attenuation from the median around the shadow and the darkest within it."""
    p = -np.log(np.maximum(y - model.ground, 0.5) / model.level)
    places = model.expected + shift
    outer = np.hypot(model.R - places[:, :1], model.C - places[:, 1:]) > 1.1 * size[:, None] + 1
    around = np.array([np.median(q[w & o]) if (w & o).any() else 0.0 for q, w, o in zip(p, use, outer, strict=True)])
    core = np.array([np.quantile(q[w], 0.95) if w.any() else 0.0 for q, w in zip(p, use, strict=True)])
    mu = np.maximum(core - around, 0.05) / (2 * model.radii)
    return np.column_stack([shift, mu, around, 0 * mu, 0 * mu])


def _most_likely(
    model: _ShadowModel, y: Float64, use: Bool, numbers: Float64, size: Float64
) -> tuple[Float64, Float64]:
    """Numbers (N, 6) of greatest Poisson likelihood, by damped Fisher scoring, and their standard deviations."""
    damping = np.full(len(y), 1e-3)
    mean, J = model(numbers)

    def cost(m: Float64) -> Float64:
        return np.asarray((use * (m - y * np.log(np.maximum(m, 1e-9)))).sum(axis=1))

    now = cost(mean)
    for _ in range(STEPS):
        weight = use / np.maximum(mean, 0.5)
        H = np.einsum("nk,nki,nkj->nij", weight, J, J, optimize=True)
        g = np.einsum("nk,nki->ni", weight * (y - mean), J)
        diagonal = np.einsum("nii->ni", H) + 1e-12
        step = np.linalg.solve(H + np.eye(6) * (diagonal * damping[:, None])[:, None], g[..., None])[..., 0]
        step[:, :2] = np.clip(step[:, :2], -0.5 * size[:, None], 0.5 * size[:, None])
        trial = numbers + step
        trial[:, 2] = np.maximum(trial[:, 2], 1e-4)
        mean_there, J_there = model(trial)
        there = cost(mean_there)
        better = there <= now
        numbers, now = np.where(better[:, None], trial, numbers), np.where(better, there, now)
        mean, J = np.where(better[:, None], mean_there, mean), np.where(better[:, None, None], J_there, J)
        damping = np.clip(np.where(better, damping / 10, damping * 10), 1e-9, 1e9)
        if (np.abs(step[:, :2]).max(axis=1) < SETTLED).all():
            break
    weight = use / np.maximum(mean, 0.5)
    H = np.einsum("nk,nki,nkj->nij", weight, J, J, optimize=True)
    spread = (weight * (y - mean) ** 2).sum(axis=1) / np.maximum(use.sum(axis=1) - 6, 1)
    variance = np.einsum("nii->ni", np.linalg.pinv(H, hermitian=True))
    return numbers, np.sqrt(np.maximum(variance, 0) * np.maximum(spread, 1e-12)[:, None])  # spread: 1 for photons
