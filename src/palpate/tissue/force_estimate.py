"""The errors of a contact force, one by one."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ForceEstimate:
    """Errors of the force of a push, relative to the force.

    Parameters
    ----------
    mesh : float
        How far finite elements on this mesh are from the continuum: estimated, not bounded. Positive if the force is too
        large.
    solver : float
        How far the answer is from the exact solution of its own equations: `Answer.error`.
    linearisation : float or None
        Difference of the force from that at finite strain, neo-Hookean or with the tissue's stiffening, direction included:
        positive if the force is too large. None if it is not known, NaN if no solution keeps every element.
    stiffness : float, optional
        Standard deviation of the force along the push, to first order, since the stiffness is known to
        `Tissue.young_spread` alone. Not an error of the calculation, and not in `total`.

    Examples
    --------
    >>> estimate = pp.model(tissue, "compliance").push(top, (0, 0, -1), 10).estimate
    >>> bool(estimate.total >= abs(estimate.mesh))
    True
    """

    mesh: float
    solver: float
    linearisation: float | None = None
    stiffness: float = 0.0

    @property
    def total(self) -> float:
        """Sum of the sizes of those that are not None; NaN if one is."""
        return abs(self.mesh) + self.solver + abs(self.linearisation or 0.0)
