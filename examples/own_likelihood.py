"""A likelihood of your own in one file: python examples/own_likelihood.py

A likelihood says how well line integrals l explain what was measured. It is any object with the five members below; a
function from a scan to one is given to `reconstruct`. This one forgives outliers: the cost of a pixel grows like the
square of its residual up to three standard deviations, and in a straight line beyond (Huber).
"""

from dataclasses import dataclass

import numpy as np

import palpate as pp
from palpate.scans.analytic_phantoms import Ellipsoid, Phantom


@dataclass(frozen=True, eq=False)
class Robust:
    """line_integrals, weights (1/variance, 0 = not measured): (views, rows, columns) float32."""

    line_integrals: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, scan: pp.Scan) -> "Robust":
        """Called once a level, with the scan at that level's resolution."""
        plain = pp.WeightedLeastSquares.of(scan)
        return cls(plain.line_integrals, plain.weights)

    @property
    def measured(self) -> np.ndarray:
        """bool: the pixels that carry weight."""
        return self.weights > 0

    def value(self, l: np.ndarray) -> float:
        """What is minimised: a sum over pixels, here r²/2 up to r = 3 and 3 r − 9/2 beyond."""
        r = np.abs(self._residual(l)).astype(np.float64)
        return float(np.where(r < 3, r**2 / 2, 3 * r - 4.5).sum())

    def slope(self, l: np.ndarray) -> np.ndarray:
        """Its derivative by each line integral."""
        return np.sqrt(self.weights) * np.clip(self._residual(l), -3, 3)

    def curvature(self, l: np.ndarray, kind: str = "optimal") -> np.ndarray:
        """Of a parabola that touches at l and stays above for all l >= 0. The weights always do; smaller is faster.

        "precomputed" is asked for once, before any l is known: the second derivative where the data are met.
        """
        if kind == "precomputed":
            return self.weights
        return self.weights * np.minimum(1, 3 / np.maximum(np.abs(self._residual(l)), 1e-6)).astype(np.float32)

    def _residual(self, l: np.ndarray) -> np.ndarray:
        return np.sqrt(self.weights) * (l - self.line_integrals)


def main() -> tuple[float, float]:
    """Relative error of the volume with plain weighted least squares, and with ours; 2 % of the pixels are wild."""
    body = Phantom([(Ellipsoid((0, 0, 24), (17, 13, 8)), 0.02), (Ellipsoid((5, 2, 24), 4), 0.02)])
    panel = pp.Panel((44, 60), (1, 1), (-29.5, -21.5, 0))
    views = pp.arc_views(panel, np.linspace(-25, 25, 7), radius=500, pivot=(0, 0, 24))
    clean = pp.simulate_scan(body, views, incident=20_000, seed=1)
    wild = np.random.default_rng(2).random(clean.shape) < 0.02
    scan = pp.Scan(np.where(wild, 0.3 * clean.counts, clean.counts), clean.incident, views)
    grid = pp.Grid((10, 32, 40), (2, 1, 1), (-19.5, -15.5, 15))
    truth = body.volume(grid).values
    volumes = [pp.reconstruct(scan, grid, likelihood=f, levels=2) for f in (pp.WeightedLeastSquares.of, Robust.of)]
    plain, ours = (float(np.linalg.norm(v.values - truth) / np.linalg.norm(truth)) for v in volumes)
    return plain, ours


if __name__ == "__main__":
    print("relative error: {:.2f} with weighted least squares, {:.2f} with outliers forgiven".format(*main()))
