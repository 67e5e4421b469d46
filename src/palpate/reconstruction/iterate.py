"""One iterate of a reconstruction."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from palpate.arrays import AnyArray, Float32
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.volumes.volume import Volume


@dataclass(frozen=True, eq=False)
class Step:
    """One iterate of a reconstruction, as `iterates` yields it.

    Parameters
    ----------
    volume : Volume
        The iterate on its level's grid, 1/mm.
    objective : float
        Its objective. Compare it within a level only.
    level : int
        0 is the finest.
    iteration : int
        1, 2, … within the level.
    seconds : float
        Time since the run began.
    finished : bool, optional
        Whether it is the last of its level.
    previous : ndarray, (z, y, x), optional
        The iterate before, if the optimizer needs both to go on.
    pace : tuple of float, optional
        Other numbers that the optimizer needs to go on.
    state : mapping of str to ndarray, optional
        What a registered optimizer needs to go on.
    prior : Prior, optional
        The prior of "map" with the strength and edge that were chosen; none in a step read from a checkpoint.

    Examples
    --------
    >>> step = next(pp.iterates(scan, grid, levels=1))
    >>> step.level, step.iteration
    (0, 1)
    """

    volume: Volume
    objective: float
    level: int
    iteration: int
    seconds: float
    finished: bool = False
    previous: Float32 | None = None
    pace: tuple[float, ...] = ()
    state: Mapping[str, AnyArray] = field(default_factory=dict)
    prior: Prior | None = None

    def _repr_html_(self) -> str:
        where = f"level {self.level}, iteration {self.iteration}{', finished' if self.finished else ''}"
        return f"<p>Step: {where}, objective {self.objective:.8g}, {self.seconds:.2f} s</p>{self.volume._repr_html_()}"
