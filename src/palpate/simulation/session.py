"""A tissue under a tool, a thousand ticks a second: by the clock with a device, or tick by tick in lockstep."""

import hashlib
from collections.abc import Sequence
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np

from palpate import _core
from palpate.arrays import Float64
from palpate.errors import DataError, FileError
from palpate.meshes.mesh import TetMesh
from palpate.meshes.shown import shown_nodes
from palpate.simulation.devices.pointer import Command
from palpate.simulation.record import Record
from palpate.tissue.base import TissueModel
from palpate.tissue.models import name_of

RATE: int = _core.RATE  # ticks a second
TICK_BUDGET = 0.4e-3  # s of each tick that sweeps may take
MOST_SWEEPS = 40
IDLE = Command()


class Device(Protocol):
    """What a session asks of a device."""

    core: Any


class Session:
    """A model of a tissue under one tool. Drive it by the clock (`start`, `stop`) or in lockstep (`step`).

    radius: of the contact, mm (default: two mean edge lengths of the surface). sweeps: of the model in each tick
    (default: as many as this machine does in 0.4 ms, measured now and kept in the record). limit: N, the most that a
    device is pushed with. Raises `DataError` on a radius or limit that is not positive, or a contact that covers too
    many nodes.
    """

    def __init__(
        self, model: TissueModel, *, radius: float | None = None, sweeps: int | None = None, limit: float = 20.0
    ) -> None:
        self.model = model
        self.mesh: TetMesh = model.tissue.mesh
        self.shown = shown_nodes(self.mesh)
        radius = 2 * mean_edge(self.mesh) if radius is None else float(radius)
        for name, value in (("radius", radius), ("limit", limit)):
            if not value > 0 or not np.isfinite(value):
                raise DataError(f"{name}: {value:g}, expected more than 0; leave it out for the default")
        self.sweep_seconds: float = _core.sweep_seconds(model.native, model.tissue.surface, radius)
        if sweeps is None:
            sweeps = max(1, min(MOST_SWEEPS, int(TICK_BUDGET / self.sweep_seconds)))
        elif not 0 < sweeps <= 10_000:
            raise DataError(f"sweeps: {sweeps}, expected 1 to 10000; leave it out to have it measured")
        self.settings = _core.Settings()
        self.settings.sweeps, self.settings.radius, self.settings.limit = int(sweeps), radius, float(limit)
        try:
            self.loop = _core.Loop(model.native, model.tissue.surface, self.shown, self.settings)
        except ValueError as problem:
            raise DataError(f"{problem}; choose a smaller radius") from None
        self._ticks = 0
        self._kept: list[tuple[Any, ...]] = []

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

    def step(self, commands: Sequence[Command | None]) -> Float64:
        """One tick a command without a clock (None: no touch). Returns (ticks, 3) N, of the tissue on the tool."""
        given = [IDLE if command is None else command for command in commands]
        ticks = np.arange(self._ticks, self._ticks + len(given), dtype=np.int64)
        return self._advance(
            _core.Replay(
                ticks,
                np.array([c.held for c in given], dtype=bool),
                np.array([c.point for c in given], dtype=np.float64).reshape(-1, 3),
                np.array([c.displacement for c in given], dtype=np.float64).reshape(-1, 3),
                np.empty(0, dtype=np.int64),
            ),
            len(given),
        )

    def replay(self, record: Record) -> int | None:
        """Obeys a record from its first tick to its last, in lockstep, as fast as the machine can.

        Returns None if every state digest agrees, else the tick by which the first one differs. The session must be
        fresh, with the record's tissue, model and settings: `DataError` otherwise.
        """
        agrees(record, self)
        if self._ticks or self.loop.frame().tick:
            raise DataError("replay: this session has run already; make a fresh one for the record")
        device = _core.Replay(record.ticks, record.held, record.points, record.displacements, record.switches)
        self._advance(device, record.length)
        mine = self.record()
        both = min(len(mine.digests), len(record.digests))
        if len(mine.digests) != len(record.digests) or (mine.digest_ticks != record.digest_ticks).any():
            return int(record.digest_ticks[both - 1]) if both else 0
        wrong = np.flatnonzero(mine.digests != record.digests)
        return int(record.digest_ticks[wrong[0]]) if len(wrong) else None

    def _advance(self, commands: Any, ticks: int) -> Float64:
        if self.loop.running:
            raise DataError("step: the session runs by the clock; call stop() first")
        forces = [np.empty((0, 3))]
        for begun in range(0, ticks, 10_000):  # the core's memory of what it obeyed is bounded
            forces.append(self.loop.step(commands, min(10_000, ticks - begun)))
            self._keep()
        return np.concatenate(forces)

    def frame(self) -> Any:
        """The newest frame: tick, late, force (N), point, displacement (mm), shown (S, 3) mm. From one thread only."""
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
        columns = [np.concatenate(parts) for parts in zip(*self._kept, self.loop.drain(), strict=True)]
        ticks, held, points, displacements, digest_ticks, digests, switches = columns
        return Record(
            ticks=ticks,
            held=held.astype(bool),
            points=points,
            displacements=displacements,
            length=int(self.loop.frame().tick),
            digest_ticks=digest_ticks,
            digests=digests,
            switches=switches,
            model=name_of(self.model),
            tissue=fingerprint(self.model),
            settings=settings_of(self),
            instructions=_core.instruction_set(),
        )

    def _keep(self) -> None:
        self._kept.append(self.loop.drain())
        if not self.loop.running:
            self._ticks = int(self.loop.frame().tick)


_SETTINGS = ("sweeps", "radius", "limit", "ramp", "approach", "reach")


def settings_of(session: Session) -> dict[str, float]:
    """What a tick does besides the model's equations, by name."""
    settings = {name: float(getattr(session.settings, name)) for name in _SETTINGS}
    return {**settings, **session.model.settings}


def agrees(record: Record, session: Session) -> None:
    """Raises `DataError` if `record` was not made with the session's tissue, model and settings."""
    if record.tissue != fingerprint(session.model):
        raise DataError(
            f"record: made on tissue {record.tissue}, not {fingerprint(session.model)}; "
            f"open the tissue it was recorded with"
        )
    if record.model != name_of(session.model):
        raise DataError(
            f"record: made with model {record.model!r}, not {name_of(session.model)!r}; say --model {record.model}"
        )
    for name, value in settings_of(session).items():
        if record.settings.get(name) != value:
            raise DataError(f"record: made with {name} = {record.settings.get(name)}, not {value:g}; use the record's")


def fingerprint(model: TissueModel) -> str:
    """A hash of what the model was made of: mesh, elastic constants, held nodes, spring law."""
    tissue, mesh, hash_ = model.tissue, model.tissue.mesh, hashlib.sha256()
    for part in (mesh.nodes, mesh.tets, mesh.region, tissue.young, tissue.poisson, tissue.fixed):
        array = np.ascontiguousarray(part)
        hash_.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
    hash_.update(repr(getattr(model, "law", None)).encode())
    return hash_.hexdigest()[:32]


def mean_edge(mesh: TetMesh) -> float:
    """mm, of the surface's edges."""
    corner = mesh.nodes[mesh.surface]
    return float(np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).mean())


def recorded_settings(record: Record) -> dict[str, Any]:
    """Keywords that make a `Session` like the recorded one."""
    try:
        return {
            "radius": record.settings["radius"],
            "sweeps": int(record.settings["sweeps"]),
            "limit": record.settings["limit"],
        }
    except KeyError as missing:
        raise FileError(f"record: it does not say {missing}; record the session again") from None


def model_settings(record: Record) -> dict[str, float]:
    """Keywords that make the recorded model from its tissue."""
    return {name: value for name, value in record.settings.items() if name not in _SETTINGS}
