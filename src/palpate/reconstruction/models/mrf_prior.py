"""The prior: a Markov random field over neighbouring voxels."""

from dataclasses import dataclass
from functools import cached_property

from palpate import _core
from palpate.arrays import Float32, float32
from palpate.errors import DataError
from palpate.reconstruction.models.potential import NAMES, TABULATED, Named, Potential, tabulate_potential
from palpate.volumes.grid import Grid

NEIGHBOURS = (6, 18, 26)


@dataclass(frozen=True)
class Prior:
    """A Markov random field: R(f) = Σ over pairs of neighbours of ω ψ(f_j − f_s).

    The weight of a pair is ω = V / (d d̄), mm, with the voxel's volume V, the distance d of the pair and the smallest
    spacing d̄. The potential is ψ(t) = δ² ψ₁(t / δ) with the edge δ.

    Parameters
    ----------
    potential : str or Potential, optional
        With s the absolute value of t / δ, ψ₁ is "quadratic" s² / 2; "huber" linear beyond the edge; "lange" s − log(1 + s);
        "hyperbola" √(1 + s²) − 1; "generalized" (q-generalized Gaussian) s² / 2 / (1 + s^(2 − q)). An object of your own
        has `value(t)` and `weight(t)`. All but "quadratic" keep edges and are for smooth objects: they flatten faint detail.
    strength : float, optional
        The objective holds β R, with β = strength × the median of the data's curvature over the voxels that some ray sees,
        1/mm. So a strength serves all doses. By default the data choose it.
    edge : float, optional
        Larger differences of attenuation are kept, 1/mm. By default the data choose it.
    neighbours : {6, 18, 26}, optional
        Voxels that share a face, at least an edge, or at least a corner.
    exponent : float, optional
        q of "generalized", from 1 to 2.
    resolution : float, optional
        Of "quadratic", instead of a strength: the full width at half maximum that a small point shall have in the slice,
        mm. The strength follows from geometry and grid, so that the width is the same at every dose.
    smooth : bool, optional
        Whether the object is even but for large structures. Then the data choose a far smaller edge, and a strength at which
        noise alone makes no structure: by the universal threshold, √(2 log n) times the noise of one of n voxels. What is
        small or faint is lost, and the level of the rest is too low. Not of "quadratic", which keeps no edges.

    Raises
    ------
    DataError
        If a value is not valid, or a potential of your own is not even or not consistent.

    References
    ----------
    Lange, IEEE TMI 9:439, 1990. Thibault et al., Med. Phys. 34:4526, 2007. Fessler & Rogers, IEEE Trans. Image
    Process. 5:1346, 1996. Donoho & Johnstone, Biometrika 81:425, 1994 (the universal threshold).

    Examples
    --------
    >>> smooth = pp.Prior("quadratic", strength=1.0, edge=0.002)
    >>> smooth.value(np.full(grid.shape, 0.02, np.float32), grid)
    0.0
    >>> step = list(pp.iterates(scan, grid, prior=pp.Prior("quadratic", resolution=6), levels=1, iterations=3))[-1]
    >>> step.prior.strength > 0
    True
    """

    potential: Named | Potential = "lange"
    strength: float | None = None
    edge: float | None = None
    neighbours: int = 26
    exponent: float = 1.2
    resolution: float | None = None
    smooth: bool = False

    def __post_init__(self) -> None:
        if self.potential == "generalised":
            object.__setattr__(self, "potential", "generalized")
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
        if self.smooth and self.resolution is not None:
            raise DataError(
                "prior: give the resolution, which keeps what is small, or smooth, which removes it; not both"
            )
        if self.resolution is not None:
            if not 0 < self.resolution < float("inf"):
                raise DataError(f"prior resolution: expected a width above 0 in mm, got {self.resolution!r}")
            if self.potential != "quadratic":
                raise DataError(
                    f'prior resolution: only of the potential "quadratic", whose response is the same for all objects; '
                    f"got {self.potential!r}"
                )
            if self.strength is not None:
                raise DataError("prior: give the resolution or the strength, which it sets; not both")
        if self.smooth:
            if self.potential == "quadratic":
                raise DataError("prior smooth: a quadratic potential keeps no edges; take another, such as lange")
            if self.strength is not None:
                raise DataError("prior: give the strength or smooth, which sets it; not both")
        _ = self._table  # raises DataError for an invalid potential before any work

    def value(self, values: Float32, grid: Grid) -> float:
        """Return R(f).

        Parameters
        ----------
        values : ndarray, (z, y, x)
            Attenuation, 1/mm.
        grid : Grid
            The voxels.

        Returns
        -------
        float
            The value.
        """
        return _core.statistics.prior_value(float32("volume", values, grid.shape), grid.spacing, *self.law)

    def surrogate(self, values: Float32, grid: Grid) -> tuple[Float32, Float32]:
        """Return the gradient of R and the curvature of a separable parabola above R.

        Parameters
        ----------
        values : ndarray, (z, y, x)
            Attenuation, 1/mm.
        grid : Grid
            The voxels.

        Returns
        -------
        tuple of ndarray, (z, y, x)
            The gradient, and Σ_s ω ψ'(t) / t for each voxel.

        References
        ----------
        Huber, Robust Statistics, 1981.
        """
        return _core.statistics.prior_surrogate(float32("volume", values, grid.shape), grid.spacing, *self.law)

    @property
    def law(self) -> tuple[_core.statistics.PriorKernel, float]:
        """The potential with its neighbours, and the edge, as the kernels take them."""
        if self.edge is None and self.potential != "quadratic":
            name = self.potential if isinstance(self.potential, str) else type(self.potential).__name__
            raise DataError(f"prior edge: a {name} potential needs one here; give edge= in 1/mm")
        kind = NAMES.index(self.potential) if isinstance(self.potential, str) else TABULATED
        bond = _core.statistics.PriorKernel(kind, self.exponent, self.neighbours, self._table)
        return bond, 1.0 if self.edge is None else self.edge

    @cached_property
    def _table(self) -> Float32 | None:
        return None if isinstance(self.potential, str) else tabulate_potential(self.potential)
