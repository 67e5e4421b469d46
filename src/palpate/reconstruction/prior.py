"""What is known of the volume before the data: neighbouring voxels are alike, except across edges."""

from dataclasses import dataclass
from functools import cached_property

from palpate import _core
from palpate.arrays import Float32, float32
from palpate.errors import DataError
from palpate.reconstruction.potential import NAMES, TABULATED, Named, Potential, table
from palpate.volumes.grid import Grid

NEIGHBOURS = (6, 18, 26)


@dataclass(frozen=True)
class Prior:
    """Markov random field: R(f) = Σ over pairs of neighbours of ω ψ(f_j − f_s), each pair once.

    ω = V / (d·d̄) in mm: V the voxel's volume, d the distance of the pair, d̄ the grid's smallest spacing. neighbours: 6
    that share a face with the voxel, 18 that share at least an edge, 26 that share at least a corner.
    potential: ψ(t) = δ² ψ₁(t/δ), δ = edge, with s = |t|/δ: "quadratic" s²/2; "huber" linear beyond the edge; "lange"
    s − log(1 + s) (Lange, IEEE TMI 9:439, 1990); "hyperbola" √(1 + s²) − 1; "generalised" s²/2 / (1 + s^(2−q)) with
    q = exponent, from 1 to 2 (q-generalised Gaussian: Thibault et al., Med. Phys. 34:4526, 2007); or an object of your
    own with value(t) and weight(t), see `Potential`.
    strength: 1/mm; the objective holds β R with β = strength × the median of the data's curvature over the voxels that
    some ray sees, so that it survives a change of dose. edge: differences of attenuation beyond it are kept, 1/mm.
    None lets the data choose (see `tune`). Raises `DataError`.
    """

    potential: Named | Potential = "lange"
    strength: float | None = None
    edge: float | None = None
    neighbours: int = 26
    exponent: float = 1.2

    def __post_init__(self) -> None:
        if isinstance(self.potential, str):
            if self.potential not in NAMES:
                raise DataError(f"prior: there is no potential {self.potential!r}; choose from {', '.join(NAMES)}")
        elif isinstance(self.potential, type) or not isinstance(self.potential, Potential):
            raise DataError(
                f"prior: a potential is one of {', '.join(NAMES)}, or an object with value(t) and weight(t); "
                f"got {self.potential!r}"
            )
        if self.strength is not None and not 0 <= self.strength < float("inf"):
            raise DataError(f"prior strength: expected 0 or more, got {self.strength!r}; None lets the data choose")
        if self.edge is not None and not 0 < self.edge < 10:
            raise DataError(
                f"prior edge: expected a difference of attenuation above 0 in 1/mm (water is about 0.02), "
                f"got {self.edge!r}; None lets the data choose"
            )
        if self.neighbours not in NEIGHBOURS:
            raise DataError(f"prior neighbours: expected 6, 18 or 26, got {self.neighbours!r}")
        if not 1 <= self.exponent <= 2:
            raise DataError(f"prior exponent: expected 1 (keeps edges) to 2 (quadratic), got {self.exponent!r}")
        _ = self._table  # a potential that cannot be is refused here, before any work

    def value(self, values: Float32, grid: Grid) -> float:
        """R(f). values: (z, y, x) 1/mm."""
        return _core.prior_value(float32("volume", values, grid.shape), grid.spacing, *self.law)

    def surrogate(self, values: Float32, grid: Grid) -> tuple[Float32, Float32]:
        """Gradient of R, and Σ_s ω ψ'(t)/t: the curvature in each voxel of a parabola above R (Huber 1981)."""
        return _core.prior_surrogate(float32("volume", values, grid.shape), grid.spacing, *self.law)

    @property
    def law(self) -> tuple[_core.Bond, float]:
        """Potential with neighbours, and edge, as the kernels take them."""
        if self.edge is None and self.potential != "quadratic":
            name = self.potential if isinstance(self.potential, str) else type(self.potential).__name__
            raise DataError(f"prior edge: a {name} potential needs one here; give edge= in 1/mm")
        kind = NAMES.index(self.potential) if isinstance(self.potential, str) else TABULATED
        bond = _core.Bond(kind, self.exponent, self.neighbours, self._table)
        return bond, 1.0 if self.edge is None else self.edge

    @cached_property
    def _table(self) -> Float32 | None:
        return None if isinstance(self.potential, str) else table(self.potential)
