"""Trains a small denoiser on one scan, without a clean volume, and judges it on views that neither it nor M-MAP has seen.

    python examples/denoise_with_jax.py

A third of the views gives a noisy volume. The network changes it, and the likelihood of another third judges the change:
noise in the first is independent of noise in the second, so that only what is common to both lowers the loss (Hendriksen,
Pelt & Batenburg, IEEE Trans. Comput. Imaging 6:1320, 2020). The last third judges the answer, beside that of M-MAP from the
same two thirds. Needs palpate[jax].
"""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np

import palpate as pp
from palpate.differentiable.jax import likelihood_value, projection


def simulated_scan(seed=0):
    """A body with two lumps on 18 views, at a low dose; its grid."""
    body = pp.Phantom(
        [
            (pp.Ellipsoid((0, 0, 24), (34, 26, 16)), 0.02),
            (pp.Ellipsoid((-8, 4, 26), 6), 0.02),
            (pp.Ellipsoid((12, -5, 22), (4, 7, 5)), 0.015),
        ]
    )
    panel = pp.Panel(shape=(48, 60), pitch=(2, 2), origin=(-59, -47, 0))
    views = pp.arc_views(panel, angles=np.linspace(-40, 40, 18), radius=500, pivot=(0, 0, 24))
    grid = pp.Grid(shape=(12, 28, 36), spacing=(3.5, 2.2, 2.2), origin=(-38.5, -29.7, 5))
    return pp.simulate_scan(body, views, incident=300, seed=seed), grid


def network(weights, x):
    """Three layers of 3 x 3 x 3 filters on a volume (z, y, x); what they give is added to it."""
    h = x[None, None] / 0.02  # about 1
    for k, (w, b) in enumerate(weights):
        h = jax.lax.conv(h, w, (1, 1, 1), "SAME") + b[:, None, None, None]
        h = jax.nn.gelu(h) if k < len(weights) - 1 else h
    return jnp.maximum(x + 0.02 * h[0, 0], 0)


def start(channels=(1, 8, 8, 1), seed=0):
    """Random filters; the last layer is 0, so that the untrained network changes nothing."""
    rng = np.random.default_rng(seed)
    weights = []
    for a, b in pairwise(channels):
        scale = np.sqrt(2 / (27 * a)) if b > 1 else 0.0
        weights.append((jnp.float32(scale * rng.standard_normal((b, a, 3, 3, 3))), jnp.zeros(b)))
    return weights


def train(weights, loss, steps, rate=3e-3):
    """Adam (Kingma & Ba, ICLR 2015)."""
    gradient = jax.jit(jax.grad(loss))
    first = second = jax.tree.map(jnp.zeros_like, weights)
    for k in range(1, steps + 1):
        g = gradient(weights)
        first = jax.tree.map(lambda m, d: 0.9 * m + 0.1 * d, first, g)
        second = jax.tree.map(lambda s, d: 0.999 * s + 0.001 * d**2, second, g)
        size = rate * np.sqrt(1 - 0.999**k) / (1 - 0.9**k)
        step = jax.tree.map(lambda m, s: m / (jnp.sqrt(s) + 1e-8), first, second)
        weights = jax.tree.map(lambda w, d, size=size: w - size * d, weights, step)
    return weights


def deviance(scan, grid, values):
    """Twice minus the log-likelihood per pixel, about 1 for the truth."""
    l = pp.Projector(scan.views, grid)(values)
    return 2 * pp.Transmission.of(scan).value(l) / scan.mask.sum()


def main(steps=150):
    """Deviance of the left-out views by answer."""
    scan, grid = simulated_scan()
    one, two, left_out = (scan[list(range(k, len(scan.views), 3))] for k in range(3))
    both = scan[[k for k in range(len(scan.views)) if k % 3 < 2]]
    noisy = [pp.reconstruct(part, grid, method="sirt", iterations=60).values for part in (one, two)]
    judges = [
        (projection(pp.Projector(part.views, grid)), likelihood_value(pp.Transmission.of(part)), part.mask.sum())
        for part in (two, one)
    ]

    def loss(weights):
        return sum(
            value(project(network(weights, x))) / n for x, (project, value, n) in zip(noisy, judges, strict=True)
        )

    weights = train(start(), loss, steps)
    answers = {
        "SIRT": np.mean(noisy, axis=0),
        "denoised": np.mean([network(weights, x) for x in noisy], axis=0),
        "M-MAP": pp.reconstruct(both, grid).values,
    }
    return {name: float(deviance(left_out, grid, values)) for name, values in answers.items()}


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:10s} deviance of the left-out views {value:.4f} a pixel")
