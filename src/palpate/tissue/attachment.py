"""Attachments: ligaments and connective tissue between two places of the surface, as springs."""

from dataclasses import dataclass

import numpy as np

from palpate.errors import MaterialError


@dataclass(frozen=True)
class Attachment:
    """A spring between two places of a tissue's surface, such as a ligament between organs.

    It pulls by `stiffness` times the way by which the two places have moved apart, whatever its direction.

    Parameters
    ----------
    first, second : tuple of float
        The places (x, y, z) at rest, mm. Each is where the surface is nearest.
    stiffness : float
        N/mm.
    radius : float, optional
        Of the patch around each place over which it pulls, mm.

    Raises
    ------
    MaterialError
        If a number is not what it may be.

    Examples
    --------
    >>> pp.Attachment((0, 0, 0), (0, 0, 12), stiffness=0.2).radius
    5.0
    """

    first: tuple[float, float, float]
    second: tuple[float, float, float]
    stiffness: float
    radius: float = 5.0

    def __post_init__(self) -> None:
        for name in ("first", "second"):
            place = tuple(float(x) for x in getattr(self, name))
            if len(place) != 3 or not np.isfinite(place).all():
                raise MaterialError(f"attachment: {name}: {place}; give a place (x, y, z), mm")
            object.__setattr__(self, name, place)
        for name, unit in (("stiffness", "N/mm"), ("radius", "mm")):
            value = float(getattr(self, name))
            if not (0 < value < 1e9):
                raise MaterialError(f"attachment: {name}: {value:g} {unit}, expected more than 0")
            object.__setattr__(self, name, value)
