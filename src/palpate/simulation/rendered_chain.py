"""What a hand feels of a tissue: model, session, and a device's coupling, limits and passivity, one tick at a time."""

import numpy as np

from palpate import _core
from palpate.arrays import ArrayLike, Float64
from palpate.errors import DataError
from palpate.simulation.pointer import KINDS, Kind
from palpate.simulation.session import RATE, Session
from palpate.tissue.contact_patches import surface_point
from palpate.tissue.models.tissue_model import TissueModel

TICK = 1 / RATE  # s
FREE_WAY = 2.0  # mm
_NS = 10**9 // RATE  # ns a tick
_START = 0.1  # mm outside: a tool in space has to be outside before it touches
_RISEN = 600  # ticks before the press: a device's force rises from nothing over half a second
_SPEED = 0.02  # mm a tick, of the press
_DRAINED = 10_000  # ticks; the loop's queues are bounded


class RenderedChain:
    """One tool over one point, in lockstep. It moves along the surface's normal, and its force is read along it.

    kind: "free", which a device sends, or "hold", which it sends while its button is down. coupling: N/mm, of the spring
    between hand and tool (`Servo`, with its force limit and its passivity controller); None connects the hand to the
    session itself. limit: N. scale: of the tissue's stiffness; exact for a model that is linear. Raises `DataError`.
    """

    def __init__(
        self,
        model: TissueModel,
        point: ArrayLike,
        radius: float,
        *,
        kind: Kind = "free",
        coupling: float | None = None,
        limit: float = 20.0,
        scale: float = 1.0,
        sweeps: int | None = None,
    ) -> None:
        if kind not in ("free", "hold"):
            raise DataError(f"kind: {kind!r}, expected 'free' or 'hold'")
        if coupling is not None and not (np.isfinite(coupling) and coupling > 0):
            raise DataError(f"coupling: {coupling:g} N/mm, expected more than 0; leave it out for none")
        at = surface_point(model.tissue, point, radius)
        self.point = np.array(at.point)
        self.normal = np.array(model.tissue.surface.normal(at))
        session = Session(model, radius=radius, limit=limit, sweeps=sweeps)
        settings = session.settings
        # A stiffer tissue under the same limits is the same tissue under smaller ones, its force multiplied.
        settings.limit, settings.ramp = limit / scale, settings.ramp / scale
        nothing_shown = np.empty(0, dtype=np.int32)
        self._loop = _core.simulation.RealtimeLoop(model.native, model.tissue.surface, nothing_shown, settings)
        self._hand = _core.simulation.Pointer()
        self._number, self._scale, self._ticks = KINDS.index(kind), scale, 0
        self._servo = None if coupling is None else _core.haptics.Servo(self._servo_settings(coupling, limit))
        self.depth = -_START if kind == "free" else 0.0

    def _servo_settings(self, coupling: float, limit: float) -> "_core.haptics.ServoSettings":
        settings = _core.haptics.ServoSettings()
        settings.period, settings.force, settings.stiffness = TICK, limit, coupling
        settings.damping = min(settings.damping, 1e-3 * coupling)  # as `Haptic` sets it
        settings.offset = self.point.tolist()
        return settings

    def tick(self, depth: float) -> float:
        """One tick with the hand `depth` mm below the surface at rest; N out of the tissue, on the hand."""
        self.depth = depth
        self._ticks += 1
        hand = -depth * self.normal
        if self._servo is None:
            return float(self._tissue_force(hand) @ self.normal)
        felt = self._servo.tick(hand.tolist(), 0, _NS * (RATE + self._ticks))
        tool = np.array(self._servo.pose().position)
        force = self._tissue_force(tool - self.point)
        frame = self._frame
        touching = frame.contact[0] == int(_core.simulation.ContactState.closed)
        # What `ServoDevice` answers: an isotropic stiffness, and the normal of a contact that can only push.
        slope = self._scale * frame.device_stiffness[0]
        can_only_push = touching and self._number == KINDS.index("free")
        normal = self.normal if can_only_push else np.zeros(3)
        self._servo.answer(
            touching,
            list(frame.tip[0]),
            force.tolist(),
            (slope * np.eye(3)).ravel().tolist(),
            normal.tolist(),
            self._ticks,
        )
        return float(np.array(felt) @ self.normal)

    def _tissue_force(self, way: Float64) -> Float64:
        """N, limited for a device, of the session's tool that is `way` mm from the point."""
        held = self._number == KINDS.index("hold")
        at, moved = (self.point, way) if held else (self.point + way, np.zeros(3))
        self._hand.send(0, self._number, at.tolist(), moved.tolist(), self._ticks)
        self._loop.step(self._hand, 1)
        if self._ticks % _DRAINED == 0:
            self._loop.drain()
        self._frame = self._loop.frame()
        return self._scale * np.array(self._frame.device_force[0])

    def free_force(self) -> float:
        """N, the largest on a tool that moves by `FREE_WAY` and back above the surface, in 0.2 s."""
        above = _START + FREE_WAY * np.sin(np.pi * np.arange(RATE // 5) / (RATE // 5)) ** 2
        moved = [self.tick(-x) for x in above.tolist()]
        return float(np.abs(moved).max())

    def press(self, depth: float, rest: float) -> float:
        """Moves the hand to `depth` mm at 20 mm/s and keeps it there for `rest` s; the force at the end, N."""
        for _ in range(0 if self._ticks else _RISEN):
            self.tick(self.depth)
        steps = max(1, round(abs(depth - self.depth) / _SPEED))
        for x in np.linspace(self.depth, depth, steps + 1)[1:].tolist():
            self.tick(x)
        for _ in range(round(rest * RATE)):
            force = self.tick(depth)
        return force
