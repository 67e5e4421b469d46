"""Weighted squares of what blurred pixels show: the blurred Poisson likelihood to second order about some line integrals."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from palpate import _core
from palpate.arrays import Bool, Float32
from palpate.reconstruction.models.likelihood import Curvature


@dataclass(frozen=True, eq=False)
class BlurredLeastSquares:
    """Σ weight (S l − p)² / 2, where S l is how a change of line integrals shows behind a blur.

    A pixel shows s_i = −log Σ_j B_ij e^(−l_j), whose derivative S_ij = B_ij x_j / Σ_k B_ik x_k, x = e⁻ˡ, is taken at some
    line integrals and kept. The rows of S have sum 1, so that Sᵀ weight is a diagonal above Sᵀ diag(weight) S (De Pierro,
    IEEE TMI 14:132, 1995).

    line_integrals: p, as the pixels show them. weights: of the pixels. taps: of the blur. passed: x. All but the taps
    (views, rows, columns), float32.
    """

    line_integrals: Float32
    weights: Float32
    taps: Float32
    passed: Float32
    light: Float32 = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "light", _core.statistics.blur_views(self.taps, self.passed))

    @classmethod
    def about(cls, l: Float32, weights: Float32, taps: Float32) -> Self:
        """The minimum is at l."""
        made = cls(np.zeros_like(l), weights, taps, np.maximum(np.exp(-l), np.float32(1e-30)))
        return cls(made.shown(l), weights, taps, made.passed)

    @property
    def measured(self) -> Bool:
        """Pixels with weight."""
        return self.weights > 0

    def shown(self, l: Float32) -> Float32:
        """S l."""
        return _core.statistics.blur_views(self.taps, self.passed * l) / self.light

    def transposed(self, s: Float32) -> Float32:
        """Sᵀ s; B is symmetric."""
        return self.passed * _core.statistics.blur_views(self.taps, s / self.light)

    def value(self, l: Float32) -> float:
        """Σ weight (S l − p)² / 2."""
        return _core.statistics.least_squares_value(self.weights, self.line_integrals, self.shown(l))

    def slope(self, l: Float32) -> Float32:
        """Sᵀ weight (S l − p)."""
        return self.transposed(self.weights * (self.shown(l) - self.line_integrals))

    def curvature(self, l: Float32, kind: Curvature = "optimal") -> Float32:
        """Of separable parabolas above, whatever l and the kind."""
        return self.transposed(self.weights)

    def curvatures_along(self, l: Float32, l_before: Float32, image: Float32) -> tuple[float, float, float]:
        """As of `Blurred`: the second derivatives along u, of u and p, along p."""
        u, p = self.shown(image), self.shown(l - l_before)
        along, both, before = _core.subspace.data_curvatures(self.weights, p, np.zeros_like(p), u)
        return along, both, before
