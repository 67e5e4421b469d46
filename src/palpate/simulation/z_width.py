"""The range of stiffness that a device can show with a chain of rendering: Z-width, by a simulation of the closed loop."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import expm

from palpate.arrays import ArrayLike, Float64
from palpate.errors import DataError
from palpate.simulation.pointer import Kind
from palpate.simulation.rendered_chain import FREE_WAY, TICK, RenderedChain
from palpate.tissue.models.tissue_model import TissueModel

REST = 0.2  # s at the depth, before the hand is let go
TICKS = 2000  # of a trial
KICK = 0.05  # of the depth: about the amplitude that a trial begins with
TRIALS = 9  # of a bisection between two stiffnesses of ratio 2: 0.2 %
STEPS = 30  # doublings or halvings before it
RIGID = 1e3  # N/mm: no tissue is stiffer
MARGIN = 0.8  # of the force limit, at most, in the press
KILOGRAM = 1e-3  # N s²/mm


@dataclass(frozen=True)
class HandImpedance:
    """A hand as a mass, a damper and a spring that move with the device.

    Parameters
    ----------
    mass : float, optional
        kg.
    damping : float, optional
        N s/mm.
    stiffness : float, optional
        N/mm, towards where the hand is when it has pressed.

    Raises
    ------
    DataError
        If a number is negative.

    Examples
    --------
    >>> pp.HandImpedance(mass=0.1, damping=0.002, stiffness=0.3).mass
    0.1
    """

    mass: float = 0.0
    damping: float = 0.0
    stiffness: float = 0.0

    def __post_init__(self) -> None:
        for name in ("mass", "damping", "stiffness"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise DataError(f"hand: {name} {value:g}, expected 0 or more")


@dataclass(frozen=True)
class ZWidth:
    """The range of stiffness that a device shows and stays passive.

    Parameters
    ----------
    least : float
        N/mm, above the tissue. The mass and the damping of the device are felt there too.
    greatest : float
        N/mm, of the press, the greatest at which the swing of hand and device fades.
    scale : float
        Of the tissue's stiffness, that gives it.
    virtual_wall : float
        2 b/T, N/mm: that of a plain spring sampled with period T, held between samples, on a device of damping b.
    bound : {"passivity", "force", "coupling"}
        What ends the range: the loop becomes active; or it is passive as far as the force limit allows, or up to a rigid
        tissue, behind the coupling.

    Examples
    --------
    >>> found = pp.z_width(pp.model(tissue, "compliance"), top, 10)
    >>> found.least, found.bound
    (0.0, 'passivity')
    """

    least: float
    greatest: float
    scale: float
    virtual_wall: float
    bound: Literal["passivity", "force", "coupling"]


def z_width(
    model: TissueModel,
    point: ArrayLike,
    radius: float,
    *,
    mass: float = 0.1,
    damping: float = 5e-4,
    hand: HandImpedance | None = None,
    depth: float = 1.0,
    kind: Kind = "free",
    coupling: float | None = None,
    limit: float = 20.0,
    sweeps: int | None = None,
) -> ZWidth:
    """Find how stiff a tissue may be before a device that shows it becomes unstable.

    A device of one degree of freedom presses with a constant force, is kicked and swings. The loop is closed tick by tick:
    the position is sampled, the session answers, and the force is held for a tick. The tissue is scaled until the swing
    does not fade.

    Parameters
    ----------
    model : TissueModel
        The model, from `pp.model`.
    point : array_like, (3,)
        Where the tool presses, mm.
    radius : float
        Of the contact, mm.
    mass : float, optional
        Of the device, kg.
    damping : float, optional
        b, of the device, N s/mm.
    hand : HandImpedance, optional
        What moves with the device. By default nothing, so that only the device dissipates energy.
    depth : float, optional
        Of the press, mm.
    kind : {"free", "hold"}, optional
        As in `transparency`.
    coupling : float, optional
        Stiffness of the spring between hand and tool, N/mm. By default there is none.
    limit : float, optional
        Largest force on the device, N.
    sweeps : int, optional
        Sweeps of the model in a tick, as in `Session`.

    Returns
    -------
    ZWidth
        The range, and what ends it.

    Raises
    ------
    DataError
        If a number is not valid, or the point is off the surface.

    Notes
    -----
    A spring of stiffness K is passive for every passive hand if b > K T/2. A device without a hand has one frequency only,
    and is stable up to nearly the same stiffness. With a hand of some stiffness and damping it is stable for more; that
    another hand keeps it so is not said. Behind a coupling a passivity controller acts, so that more than one stiffness may
    end the range; the bisection finds one of them. Scaling is exact for linear models only.

    References
    ----------
    Colgate & Brown, Factors affecting the Z-width of a haptic display, Proc. IEEE Int. Conf. Robotics and Automation, 1994,
    3205.
    Colgate & Schenkel, Passivity of a class of sampled-data systems: application to haptic interfaces, J. Robotic Systems 14
    (1997) 37.

    Examples
    --------
    >>> found = pp.z_width(pp.model(tissue, "compliance"), top, 10, damping=5e-4)
    >>> 0.9 < found.greatest / found.virtual_wall < 1.1
    True
    """
    for name, value in (("mass", mass), ("damping", damping), ("depth", depth)):
        if not (np.isfinite(value) and value > 0):
            raise DataError(f"{name}: {value:g}, expected more than 0")
    loop = ClosedLoop(mass, damping, hand or HandImpedance())

    def pressed(scale: float) -> tuple[RenderedChain, float]:
        chain = RenderedChain(
            model, point, radius, kind=kind, coupling=coupling, limit=limit, scale=scale, sweeps=sweeps
        )
        return chain, chain.press(depth, REST)

    chain, force = pressed(1.0)
    if not force > 0:
        raise DataError(f"depth: the tissue does not push back at {depth:g} mm; give another point or depth")
    if force > MARGIN * limit:
        raise DataError(
            f"depth: {depth:g} mm takes {force:.3g} N of {limit:g} N; press less deep, or give a larger limit"
        )
    own = float(model.push(chain.point, -depth * chain.normal, radius).force @ chain.normal / depth)  # N/mm
    felt: dict[float, float] = {}

    def passive(scale: float) -> bool:
        chain, force = pressed(scale)
        felt[scale] = force / depth
        return loop.fades(chain, force, depth)

    above = RenderedChain(model, point, radius, coupling=coupling, limit=limit, sweeps=sweeps)
    least = above.free_force() / FREE_WAY
    wall = 2 * damping / TICK

    def found(scale: float, bound: Literal["passivity", "force", "coupling"]) -> ZWidth:
        return ZWidth(least, felt[scale], scale, wall, bound)

    low = MARGIN * min(wall / own, limit / (own * depth))
    ways = 0
    while not passive(low):
        low, ways = low / 2, ways + 1
        if ways > STEPS:
            return ZWidth(least, 0.0, 0.0, wall, "passivity")
    high = 2 * low
    most = float("inf") if coupling is None else coupling
    while min(2 * felt[low], most) * depth <= MARGIN * limit:
        if high * own > RIGID:
            return found(low, "coupling")
        if not passive(high):
            break
        low, high = high, 2 * high
    else:
        return found(low, "force")
    for _ in range(TRIALS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if passive(middle) else (low, middle)
    return found(low, "passivity")


class ClosedLoop:
    """Device and hand as one mass, solved exactly between ticks, since the force is held for each."""

    def __init__(self, mass: float, damping: float, hand: HandImpedance) -> None:
        m, b = KILOGRAM * (mass + hand.mass), damping + hand.damping
        self.mass, self.spring = m, hand.stiffness
        system = np.array([[0, 1, 0], [-hand.stiffness / m, -b / m, 1 / m], [0, 0, 0]])
        step: Float64 = expm(system * TICK)
        self.step = step[:2].tolist()

    def fades(self, chain: RenderedChain, press: float, depth: float) -> bool:
        """Whether a swing about the depth, begun by a kick, fades; press: N, at rest."""
        # A kick that turns back at about this amplitude, if the chain is a spring.
        v = KICK * depth * float(np.sqrt((press / depth + self.spring) / self.mass))
        x, largest, speeds = 0.0, 0.0, np.empty(TICKS)
        (xx, xv, xf), (vx, vv, vf) = self.step
        for n in range(TICKS):
            force = press - chain.tick(depth + x)
            x, v = xx * x + xv * v + xf * force, vx * x + vv * v + vf * force
            speeds[n], largest = v, max(largest, abs(x))
            if not largest < 0.5 * depth:  # it grows, or leaves
                return False
        first, last = speeds.reshape(2, -1)
        window = np.hanning(len(first))  # so that a part of a period at the ends does not count
        return bool(window @ last**2 < window @ first**2)
