"""A tissue under tools, a thousand ticks a second: by the clock with a device, or tick by tick in lockstep."""

from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np

from palpate import _core
from palpate.arrays import Float64
from palpate.errors import DataError
from palpate.meshes.mesh import TetMesh
from palpate.meshes.shown import shown_nodes
from palpate.simulation.devices.pointer import TOOLS, Command
from palpate.simulation.devices.replay import Replay
from palpate.simulation.journal import Journal
from palpate.simulation.likeness import agrees, fingerprint, follows, settings_of
from palpate.simulation.record import Record
from palpate.tissue.base import TissueModel
from palpate.tissue.models import model as build
from palpate.tissue.models import name_of

RATE: int = _core.RATE  # ticks a second
TICK_BUDGET = 0.4e-3  # s of each tick that sweeps may take
MOST_SWEEPS = 40
IDLE = Command()
LUMP, SAMPLE = 0, 1  # what a hand may claim: `Session.mark`
Given = Command | None | Sequence[Command | None]  # of one tool, or of up to four


class Device(Protocol):
    """What a session asks of a device."""

    core: Any


class Session:
    """A model of a tissue under up to four tools. Drive it by the clock (`start`, `stop`) or in lockstep (`step`).

    radius: of the contact, mm (default: two mean edge lengths of the surface). sweeps: of the model in each tick
    (default: as many as this machine does in 0.4 ms, measured now and kept in the record). limit: N, the most that a
    device is pushed with. friction: Coulomb's, of tools in space. Raises `DataError` on a radius or limit that is not
    positive, a negative friction, or a contact that covers too many nodes.
    """

    def __init__(
        self,
        model: TissueModel,
        *,
        radius: float | None = None,
        sweeps: int | None = None,
        limit: float = 20.0,
        friction: float = 0.3,
    ) -> None:
        self.first = self.model = model
        self.mesh: TetMesh = model.tissue.mesh
        self.shown = shown_nodes(self.mesh)
        radius = 2 * mean_edge(self.mesh) if radius is None else float(radius)
        for name, value in (("radius", radius), ("limit", limit)):
            if not value > 0 or not np.isfinite(value):
                raise DataError(f"{name}: {value:g}, expected more than 0; leave it out for the default")
        if not friction >= 0 or not np.isfinite(friction):
            raise DataError(f"friction: {friction:g}, expected 0 or more; leave it out for the default")
        self.sweep_seconds: float = _core.sweep_seconds(model.native, model.tissue.surface, radius)
        self.settings = _core.Settings()
        self.settings.sweeps = self._sweeps(sweeps, self.sweep_seconds)
        self.settings.radius, self.settings.limit, self.settings.friction = radius, float(limit), float(friction)
        try:
            self.loop = _core.Loop(model.native, model.tissue.surface, self.shown, self.settings)
        except ValueError as problem:
            raise DataError(f"{problem}; choose a smaller radius") from None
        self._ticks = 0
        self._kept = Journal()
        self._came: list[tuple[TissueModel, int]] = []  # models and their sweeps, in the order of `change`
        self._changes: list[int] = []  # ticks from which they ran
        self._marks: list[tuple[int, int, int]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.stop()

    def start(self, device: Device) -> None:
        """Runs by the clock, `RATE` ticks a second, with `device` at the other end."""
        self.loop.start(device.core)

    def stop(self) -> None:
        """Lets go and ends the run; the last force is zero. Does nothing if the session does not run."""
        self.loop.stop()
        self._keep()

    def step(self, commands: Sequence[Given]) -> Float64:
        """One tick an item without a clock: a command (None: no touch), or a sequence of one for each of several tools.

        Returns (ticks, 3) N, of the tissue on the first tool; (ticks, 4, 3), of all, where several were commanded.
        """
        alone = all(given is None or isinstance(given, Command) for given in commands)
        given = [row for at, item in enumerate(commands) for row in _rows(self._ticks + at, item)]
        device = _core.Replay(
            np.array([at for at, _, _ in given], dtype=np.int64),
            np.array([tool for _, tool, _ in given], dtype=np.uint8),
            np.array([c.number for _, _, c in given], dtype=np.uint8),
            np.array([c.point for _, _, c in given], dtype=np.float64).reshape(-1, 3),
            np.array([c.displacement for _, _, c in given], dtype=np.float64).reshape(-1, 3),
            np.empty(0, dtype=np.int64),
            np.empty(0, dtype=np.uint8),
        )
        force = self._advance(device, len(commands))
        return force[:, 0] if alone else force

    def change(self, model: TissueModel, sweeps: int | None = None) -> bool:
        """Goes on with another model of the same tissue, blended in within 0.3 s so that the force has no step.

        By the clock or not. False, and nothing changed, while an earlier change is under way. Raises `DataError` for a
        model of another tissue, or of springs by a law that is not the tissue's.
        """
        if not follows(model, self.first):
            raise DataError("change: the model is of another tissue or spring law; make it of the session's own tissue")
        seconds = _core.sweep_seconds(model.native, model.tissue.surface, self.settings.radius)
        done = self._sweeps(sweeps, seconds)
        if not self.loop.change(model.native, done):
            return False
        self.model = model
        self._came.append((model, done))
        return True

    def mark(self, what: int, tool: int = 0) -> None:
        """Notes what the hand claims now: `LUMP` under a tool, or `SAMPLE` taken at a needle's tip; for scores."""
        if what not in (LUMP, SAMPLE) or not 0 <= tool < TOOLS:
            raise DataError(f"mark: {what} of tool {tool}, expected 0 or 1 of tool 0 to {TOOLS - 1}")
        self._marks.append((int(self.loop.frame().tick), what, tool))

    @staticmethod
    def _sweeps(asked: int | None, seconds: float) -> int:
        """As many as fit a tick, if none are asked for."""
        if asked is None:
            return max(1, min(MOST_SWEEPS, int(TICK_BUDGET / seconds)))
        if not 0 < asked <= 10_000:
            raise DataError(f"sweeps: {asked}, expected 1 to 10000; leave it out to have it measured")
        return int(asked)

    def replay(self, record: Record) -> int | None:
        """Obeys a record from its first tick to its last, in lockstep, as fast as the machine can.

        Returns None if every state digest agrees, else the tick by which the first one differs. The session must be
        fresh, with the record's tissue, model and settings: `DataError` otherwise.
        """
        agrees(record, self.first, self.settings)
        if self._ticks or self.loop.frame().tick:
            raise DataError("replay: this session has run already; make a fresh one for the record")
        for _ in self.replayed(record, record.length):
            pass
        mine = self.record()
        both = min(len(mine.digests), len(record.digests))
        if len(mine.digests) != len(record.digests) or (mine.digest_ticks != record.digest_ticks).any():
            return int(record.digest_ticks[both - 1]) if both else 0
        wrong = np.flatnonzero(mine.digests != record.digests)
        return int(record.digest_ticks[wrong[0]]) if len(wrong) else None

    def replayed(self, record: Record, every: int) -> Iterator[tuple[int, Float64]]:
        """Obeys a record in lockstep, `every` ticks at a time: the ticks done and (those, 4, 3) N. For scores.

        It also stops where a model changed or something was marked.
        """
        device = Replay(record).core
        made = {name: self.first if name == record.model else build(self.first.tissue, name) for name in _named(record)}
        changes = list(record.changes)
        while self._ticks < record.length:
            if changes and changes[0][0] == self._ticks:
                _, name, sweeps = changes.pop(0)
                self.change(made[name], sweeps)
            stop = min(record.length, self._ticks - self._ticks % every + every)
            stop = min([stop, *(at for at, *_ in (*changes, *record.marks) if at > self._ticks)])
            force = self._advance(device, stop - self._ticks)
            yield self._ticks, force

    def _advance(self, commands: Any, ticks: int) -> Float64:
        if self.loop.running:
            raise DataError("step: the session runs by the clock; call stop() first")
        forces = [np.empty((0, TOOLS, 3))]
        for begun in range(0, ticks, 10_000):  # the core's memory of what it obeyed is bounded
            forces.append(self.loop.step(commands, min(10_000, ticks - begun)))
            self._keep()
        return np.concatenate(forces)

    def frame(self) -> Any:
        """The newest frame: tick, late, work (N mm) and, tool by tool, grip, force (N), point, displacement, tip (mm).

        shown: (S, 3) mm. From one thread only.
        """
        if self.loop.running:
            self._keep()
        return self.loop.frame()

    @property
    def displacement(self) -> Float64:
        """(N, 3) mm of every node, now. Not while the session runs by the clock."""
        if self.loop.running:
            raise DataError("displacement: the session runs by the clock; call stop() first, or look at frame().shown")
        return np.array(self.loop.displacement())

    def record(self) -> Record:
        """All that was commanded so far. Raises `DataError` if the record has gaps, or while the session runs."""
        if self.loop.running:
            raise DataError("record: the session runs by the clock; call stop() first")
        if lost := self.loop.dropped():
            raise DataError(f"record: {lost} entries were lost since nobody read frames for minutes; record again")
        self._kept.add(self.loop.drain())
        ticks, tools, kinds, points, displacements, digest_ticks, digests, switches, lacking = self._kept.columns()
        return Record(
            ticks=ticks,
            tools=tools,
            kinds=kinds,
            points=points,
            displacements=displacements,
            length=int(self.loop.frame().tick),
            digest_ticks=digest_ticks,
            digests=digests,
            switches=switches,
            lacking=lacking,
            model=name_of(self.first),
            tissue=fingerprint(self.first),
            settings=settings_of(self.first, self.settings),
            instructions=_core.instruction_set(),
            changes=tuple((at, name_of(m), n) for at, (m, n) in zip(self._changes, self._came, strict=False)),
            marks=tuple(self._marks),
        )

    def _keep(self) -> None:
        self._kept.add(self.loop.drain())
        self._changes += [tick for tick, _ in self.loop.changes()]
        self.loop.tidy()
        if not self.loop.running:
            self._ticks = int(self.loop.frame().tick)


def _rows(tick: int, given: Given) -> list[tuple[int, int, Command]]:
    """A tick's commands as (tick, tool, command) of every tool: those that are not named let go."""
    named = [given] if given is None or isinstance(given, Command) else list(given)
    if len(named) > TOOLS:
        raise DataError(f"step: {len(named)} tools, at most {TOOLS} can be at work")
    named += [None] * (TOOLS - len(named))
    return [(tick, tool, IDLE if command is None else command) for tool, command in enumerate(named)]


def _named(record: Record) -> set[str]:
    return {record.model, *(name for _, name, _ in record.changes)}


def mean_edge(mesh: TetMesh) -> float:
    """mm, of the surface's edges."""
    corner = mesh.nodes[mesh.surface]
    return float(np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).mean())
