"""One iterate of a reconstruction."""

from dataclasses import dataclass

from palpate.arrays import Float32
from palpate.volumes.volume import Volume


@dataclass(frozen=True, eq=False)
class Step:
    """volume: a snapshot on its level's grid, 1/mm. level: 0 is the finest. iteration: 1, 2, ... within the level.

    objective: compares only within a level. seconds: since the run began, monitoring included. finished: the last of
    its level. previous: the iterate before (z, y, x), where the optimiser goes on from both; it may share memory with
    that step's volume. pace: numbers that it goes on from besides (see `Pace`).
    """

    volume: Volume
    objective: float
    level: int
    iteration: int
    seconds: float
    finished: bool = False
    previous: Float32 | None = None
    pace: tuple[float, ...] = ()

    def _repr_html_(self) -> str:
        where = f"level {self.level}, iteration {self.iteration}{', finished' if self.finished else ''}"
        return f"<p>Step: {where}, objective {self.objective:.8g}, {self.seconds:.2f} s</p>{self.volume._repr_html_()}"
