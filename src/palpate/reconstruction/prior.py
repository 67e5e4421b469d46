"""What is known of the volume before the data: neighbouring voxels are alike, except across edges."""

from dataclasses import dataclass
from typing import Literal

from palpate import _core
from palpate.arrays import Float32, float32
from palpate.errors import DataError
from palpate.volumes.grid import Grid

Potential = Literal["quadratic", "huber", "lange"]
POTENTIALS: tuple[Potential, ...] = ("quadratic", "huber", "lange")


@dataclass(frozen=True)
class Prior:
    """Markov random field over 26 neighbours: R(f) = Σ over pairs ω ψ(f_j − f_s), each pair once.

    ω = V / (d·d̄) in mm: V the voxel's volume, d the distance of the pair, d̄ the grid's smallest spacing. potential:
    "quadratic" t²/2, "huber" (linear beyond the edge), or "lange" δ²(|t/δ| − log(1 + |t/δ|)) (Lange, IEEE TMI 9:439,
    1990), δ = edge.
    strength: 1/mm; the objective holds β R with β = strength × the median of the data's curvature over the voxels that
    some ray sees, so that it survives a change of dose. edge: differences of attenuation beyond it are kept, 1/mm.
    None lets the data choose (see `tune`). Raises `DataError`.
    """

    potential: Potential = "lange"
    strength: float | None = None
    edge: float | None = None

    def __post_init__(self) -> None:
        if self.potential not in POTENTIALS:
            raise DataError(f"prior: there is no potential {self.potential!r}; choose from {', '.join(POTENTIALS)}")
        if self.strength is not None and not 0 <= self.strength < float("inf"):
            raise DataError(f"prior strength: expected 0 or more, got {self.strength!r}; None lets the data choose")
        if self.edge is not None and not 0 < self.edge < 10:
            raise DataError(
                f"prior edge: expected a difference of attenuation above 0 in 1/mm (water is about 0.02), "
                f"got {self.edge!r}; None lets the data choose"
            )

    def value(self, values: Float32, grid: Grid) -> float:
        """R(f). values: (z, y, x) 1/mm."""
        return _core.prior_value(float32("volume", values, grid.shape), grid.spacing, *self.law)

    def surrogate(self, values: Float32, grid: Grid) -> tuple[Float32, Float32]:
        """Gradient of R, and Σ_s ω ψ'(t)/t: the curvature in each voxel of a parabola above R (Huber 1981)."""
        return _core.prior_surrogate(float32("volume", values, grid.shape), grid.spacing, *self.law)

    @property
    def law(self) -> tuple[int, float]:
        """Potential and edge as the kernels take them."""
        if self.edge is None and self.potential != "quadratic":
            raise DataError(f"prior edge: a {self.potential} potential needs one here; give edge= in 1/mm")
        return POTENTIALS.index(self.potential), 1.0 if self.edge is None else self.edge
