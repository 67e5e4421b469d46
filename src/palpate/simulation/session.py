"""A session: a tissue under tools at 1000 ticks a second, by the clock with a device, or in lockstep."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from threading import Lock
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np

from palpate import _core
from palpate.arrays import Float32, Float64, Int32
from palpate.errors import DataError, MaterialError
from palpate.meshes.cutting.blade import Blade
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.meshes.tet_mesh import TetMesh
from palpate.simulation.cut_bodies import CutBody, cut_once_more, model_after, taken_by_name
from palpate.simulation.cut_works import held_points, work_of_cut
from palpate.simulation.displayed_bodies import DisplayedBodies
from palpate.simulation.event_collector import EventCollector
from palpate.simulation.loose_pieces import LoosePiece, loop_arguments, pieces_after
from palpate.simulation.pointer import TOOLS, Command
from palpate.simulation.recording import Record
from palpate.simulation.scripted_device import Given, ScriptedDevice, new_commands
from palpate.simulation.session_compatibility import check_record, description_of, has_nodal_weights, same_tissue
from palpate.simulation.session_cuts import CutKind, RecordedCut
from palpate.simulation.session_events import SessionEvents
from palpate.simulation.session_journal import SessionJournal
from palpate.simulation.session_replay import ReplaySteps, first_difference
from palpate.simulation.session_settings import (
    require_time_dependence,
    simulation_settings,
    sweep_seconds,
    sweeps_in_tick,
)
from palpate.tissue.cutting_work import CuttingWork, cutting_work
from palpate.tissue.models.registry import name_of
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.tissue import Tissue

RATE: int = _core.simulation.RATE  # ticks a second
LUMP, SAMPLE = 0, 1  # what `Session.mark` may note


class Device(Protocol):
    """What a session asks of a device."""

    core: Any


class Session:
    """A model of a tissue under up to four tools, with ticks of 1 ms.

    Run it in real time (`start`, `stop`) or without a clock (`step`).

    Parameters
    ----------
    model : TissueModel
        The model, from `pp.model`.
    radius : float, optional
        Radius of the contact, mm. The default is two mean edges of the surface.
    sweeps : int, optional
        Sweeps of the model in a tick. The default is what this machine does in 0.4 ms.
    limit : float, optional
        Largest force on a device, N.
    friction : float, optional
        Coulomb's coefficient, for free tools.
    tension : float, optional
        Of the tissue at rest, kPa: how far a display opens cuts, as `gape` does. No force depends on it.
    regions : bool, optional
        Whether a display may draw what is inside.
    toughness : float or dict, optional
        Energy that a cut takes for each area, J/m², as `cutting_work` takes it. The default is that of the named tissues.
        A blade feels the tissues that its edge is in.
    blade_friction : float, optional
        Force on each mm of a blade's edge in the tissue, N/mm.

    Raises
    ------
    DataError
        If a number is not valid, or the contact covers too many nodes.
    MaterialError
        If the tissue relaxes or has inertia, and the model does not follow.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> force = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 200)
    >>> bool(force[-1, 2] > 0)
    True
    """

    def __init__(
        self,
        model: TissueModel,
        *,
        radius: float | None = None,
        sweeps: int | None = None,
        limit: float = 20.0,
        friction: float = 0.3,
        tension: float = 0.0,
        regions: bool = True,
        toughness: float | Mapping[int | str, float] | None = None,
        blade_friction: float = 0.0,
    ) -> None:
        require_time_dependence(model)
        self.first = self.model = model
        self._bodies: tuple[CutBody, ...] = (CutBody(model.tissue),)  # the first, and after each cut that there is
        self.toughness, self.blade_friction = toughness, float(blade_friction)
        cutting_work(model.tissue, model.tissue, toughness, self.blade_friction)  # refuses what cannot be
        self.lesson = ""  # of the record
        self.bodies = 0  # how often the body has been changed
        self._surfaces = DisplayedBodies(tension, regions)
        self.displayed = self._surfaces.add(self.bodies, model)
        self.settings = simulation_settings(model.tissue, radius, limit, friction, toughness, self.blade_friction)
        self.sweep_seconds = sweep_seconds(model, self.settings.radius)
        self.settings.sweeps = sweeps_in_tick(self.sweep_seconds, sweeps)
        try:
            self.loop = self._new_loop()
        except ValueError as problem:
            raise DataError(f"{problem}; choose a smaller radius") from None
        self._ticks = 0
        self.events = SessionEvents()
        self._lock = Lock()  # a change of model frees the retired one, and so does the collector
        self._collector: EventCollector | None = None

    def _new_loop(self) -> Any:
        native, surface = self.model.native, self.model.tissue.surface
        return _core.simulation.RealtimeLoop(native, surface, self.displayed.nodes, self.settings)

    @property
    def tension(self) -> float:
        """Of the tissue at rest, kPa, by which a display opens cuts."""
        return self._surfaces.tension

    @property
    def journal(self) -> SessionJournal | None:
        """Takes the events of a session that runs by the clock, as they come."""
        return self.events.journal

    @journal.setter
    def journal(self, journal: SessionJournal | None) -> None:
        self.events.journal = journal

    @property
    def tissue(self) -> Tissue:
        """The tissue, with all cuts so far."""
        return self._bodies[-1].tissue

    @property
    def cuts(self) -> int:
        """How many cuts of this session it has."""
        return len(self._bodies) - 1

    @property
    def cutting_work(self) -> tuple[CuttingWork, ...]:
        """The work of each cut that it has, of an extended one all of it."""
        return tuple(body.work for body in self._bodies if body.work is not None)

    @property
    def taken(self) -> dict[str, float]:
        """Volumes of the pieces that its cuts have freed, by name of the region, mm³."""
        return taken_by_name(self.tissue)

    @property
    def pieces(self) -> tuple[LoosePiece, ...]:
        """The pieces that its cuts have freed, the largest first: bodies of their own, at most 16.

        A frame says where they are: `Frame.piece_state`, and `Frame.piece_offset`, (p, 3) mm from where each came free.
        """
        return self._bodies[-1].pieces

    @property
    def mesh(self) -> TetMesh:
        """Its mesh."""
        return self.tissue.mesh

    def _repr_html_(self) -> str:
        from palpate.tissue.tissue_card import tissue_card  # only a notebook asks

        s, model = self.settings, name_of(self.model)
        contact = f"radius {s.radius:.3g} mm, friction {s.friction:g}, at most {s.limit:g} N on a device"
        cuts = (("Cuts", str(self.cuts)),) if self.cuts else ()
        return tissue_card(self.tissue, f"Session of model {model}", (("Contact", contact), *cuts))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.stop()

    def start(self, device: Device) -> None:
        """Run in real time, at `RATE` ticks a second, with a device.

        Parameters
        ----------
        device : Device
            Such as a `Pointer`.
        """
        self.loop.start(device.core)
        self._collector = EventCollector(self._collect)

    def stop(self) -> None:
        """Release the tissue and end the run. The last force is zero. Nothing happens if the session does not run."""
        self.loop.stop()
        if self._collector:
            self._collector.stop()
            self._collector = None
        self.events.collect(self.loop)
        self._ticks = int(self.loop.frame().tick)

    def _collect(self) -> None:
        with self._lock:
            self.events.collect(self.loop)

    def step(self, commands: Sequence[Given]) -> Float64:
        """Run ticks without a clock.

        Parameters
        ----------
        commands : sequence
            One item for each tick: a command, None for no touch, or a sequence with one for each tool.

        Returns
        -------
        ndarray, (ticks, 3) or (ticks, 4, 3)
            Force of the tissue, or the weight of a piece, on the first tool, or on all tools if several were commanded, N.
        """
        alone = all(given is None or isinstance(given, Command) for given in commands)
        given = list(new_commands(self._ticks, commands))
        device = ScriptedDevice([at for at, *_ in given], [c for *_, c in given], [tool for _, tool, _ in given])
        force = self._advance(device.core, len(commands))
        return force[:, 0] if alone else force

    def change(self, model: TissueModel, sweeps: int | None = None) -> bool:
        """Continue with another model of the same tissue. Forces are blended over 0.3 s.

        Parameters
        ----------
        model : TissueModel
            The new model.
        sweeps : int, optional
            Sweeps in a tick.

        Returns
        -------
        bool
            False if an earlier change is not finished; then nothing changes.

        Raises
        ------
        DataError
            If the model is of another tissue, or its springs follow another law.
        MaterialError
            If the tissue relaxes or has inertia, and the model does not follow.
        """
        if not same_tissue(model, self.model if self.bodies else self.first):
            raise DataError("change: the model is of another tissue or spring law; make it of the session's own tissue")
        require_time_dependence(model)
        done = sweeps_in_tick(sweep_seconds(model, self.settings.radius), sweeps)
        with self._lock:
            if not self.loop.change(model.native, done):
                return False
            self.model = model
            self.events.model(name_of(model), done)
        return True

    def cut(self, blade: Blade, *, extend: bool = False) -> bool:
        """Cut the tissue, while the session runs or between two steps.

        The tissue is cut and factored first, which takes part of a second; ticks go on meanwhile. Then the cut body takes
        over within a tick. Tools that touch it stay where they are, and their forces fade into those of the cut body. A piece
        that comes free, which no three nodes hold, is a body of its own from then on (`pieces`), and a tool that held it
        carries it.

        Parameters
        ----------
        blade : Blade
            What passes through the tissue, such as `incision(session.tissue, path, depth)`.
        extend : bool, optional
            Whether this cut takes the place of the last one, as a longer blade of the same stroke does.

        Returns
        -------
        bool
            False if an earlier change is not finished; then nothing changes.

        Raises
        ------
        MaterialError
            If nothing would be left that is held, the model is not `compliance`, or the tissue relaxes or has inertia.
        DataError
            If there is nothing to extend.

        Examples
        --------
        >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10)
        >>> session.cut(pp.incision(tissue, [top - (8, 0, 0), top + (8, 0, 0)], depth=10))
        True
        """
        return self._change_body("extend" if extend else "cut", blade)

    def undo(self) -> bool:
        """Take back the last cut.

        Returns
        -------
        bool
            False if an earlier change is not finished; then nothing changes.

        Raises
        ------
        DataError
            If nothing has been cut in this session.
        """
        return self._change_body("undo", None)

    def cut_again(self, one: RecordedCut) -> bool:
        """Do what a record says: cut, cut longer, or take back.

        Parameters
        ----------
        one : RecordedCut
            One of `Record.cuts`.

        Returns
        -------
        bool
            False if an earlier change is not finished; then nothing changes.
        """
        return self._change_body(one.kind, one.blade)

    def _change_body(self, kind: CutKind, blade: Blade | None) -> bool:
        name = name_of(self.model)
        if name != "compliance":
            raise MaterialError(f"cut: the model {name} cannot go on after a cut; change to compliance first")
        with self._lock:
            if self.loop.change_pending():  # before a second of work that it would refuse
                return False
        if self.first.tissue.time_dependent:
            raise MaterialError(
                "cut: a tissue that relaxes or has inertia is not cut in a session; cut it before: pp.cut"
            )
        before, present = self.model, self._bodies[-1]
        bodies = self._bodies if kind == "cut" else self._bodies[:-1]
        if not bodies:
            raise DataError(f"{kind}: nothing has been cut in this session; cut first")
        tissue = bodies[-1].tissue
        freed: tuple[CutMesh, ...] = ()
        if blade is not None:
            tissue, freed = cut_once_more(self.first.tissue, tissue, blade)
        model = model_after(tissue, self.first, before)
        displayed = self._surfaces.add(self.bodies + 1, model)
        held = held_points(self.loop.frame(), self.settings.radius)  # late: tools move while the model is made
        if blade is not None:
            bodies = (*bodies, CutBody(tissue, pieces_after(freed, present.pieces, before, tissue, held)))
        beside = loop_arguments(bodies[-1].pieces, present.pieces, self.first.tissue)
        body = (model.native, tissue.surface, displayed.nodes, self.settings.sweeps)
        with self._lock:
            try:
                done = self.loop.change_body(*body, *beside)
            except ValueError as problem:
                raise DataError(f"cut: {problem}; cut less, or choose a smaller radius") from None
            if not done:
                return False
            self._bodies, self.model, self.displayed = bodies, model, displayed
            self.bodies += 1
            self.events.cut(kind, blade)
        if blade is not None:  # the loop need not wait for it
            extended = present.work if kind == "extend" else None
            work = work_of_cut(before, model, held, self.toughness, self.blade_friction, extended)
            self._bodies = (*bodies[:-1], replace(bodies[-1], work=work))
        return True

    @property
    def shown(self) -> Int32:
        """The nodes of `Frame.shown`, (n,), while no cut is on its way."""
        return self.displayed.nodes

    def drawn(self, frame: Any) -> Float32:
        """Return how the surface that is drawn has moved.

        Parameters
        ----------
        frame : Frame
            A frame of this session.

        Returns
        -------
        ndarray, (S, 3)
            Displacements of the vertices of the surface, mm; of a cut tissue also those of its lips.
        """
        return self._surfaces.moved(frame)

    def mark(self, what: int, tool: int = 0) -> None:
        """Record what the trainee claims, for the score.

        Parameters
        ----------
        what : int
            `LUMP` (a lump is under the tool) or `SAMPLE` (the needle's tip is in it).
        tool : int, optional
            Which tool.
        """
        if what not in (LUMP, SAMPLE) or not 0 <= tool < TOOLS:
            raise DataError(f"mark: {what} of tool {tool}, expected 0 or 1 of tool 0 to {TOOLS - 1}")
        self.events.marks.append((int(self.loop.frame().tick), what, tool))

    def note(self, text: str, point: Sequence[float]) -> None:
        """Keep a note with the record of this session.

        Parameters
        ----------
        text : str
            At most 200 characters. Line breaks become blanks; control characters are taken out.
        point : sequence of 3 floats
            Where it is, mm, on the surface at rest.

        Raises
        ------
        DataError
            If the text is empty or too long, the point is not finite, or there are 100 notes.

        Examples
        --------
        >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10)
        >>> session.note("hard here", top)
        >>> session.record().notes[0].text
        'hard here'
        """
        self.events.add_note(int(self.loop.frame().tick), point, text)

    def remove_note(self, index: int) -> None:
        """Remove a note.

        Parameters
        ----------
        index : int
            Its index in the order in which the notes were made.

        Raises
        ------
        DataError
            If there is no such note.
        """
        self.events.remove_note(index)

    def replay(self, record: Record) -> int | None:
        """Replay a record without a clock, as fast as possible.

        Parameters
        ----------
        record : Record
            A record of the same tissue, model and settings.

        Returns
        -------
        int or None
            None if every state agrees, else the first tick that differs.

        Raises
        ------
        DataError
            If the session is not fresh or does not match.
        """
        check_record(record, self.first, self.settings)
        if self._ticks or self.loop.frame().tick:
            raise DataError("replay: this session has run already; make a fresh one for the record")
        for _ in self.replayed(record, record.length):
            pass
        return first_difference(record, self.record())

    def use_weights_of(self, record: Record) -> None:
        """Weigh the nodes of contacts as the session of a record did: by integrals, or as version 0.1 did.

        Parameters
        ----------
        record : Record
            The record.

        Raises
        ------
        DataError
            If this session has run already.
        """
        if bool(self.settings.nodal_weights) == has_nodal_weights(record):
            return
        if self.loop.running or self._ticks or self.loop.frame().tick:
            raise DataError("replay: this session has run already; make a fresh one for the record")
        self.settings.nodal_weights = has_nodal_weights(record)
        self.loop = self._new_loop()

    def replayed(self, record: Record, every: int) -> Iterator[tuple[int, Float64]]:
        """Replay a record and yield the forces. It stops also where a model changed or something was marked.

        Parameters
        ----------
        record : Record
            The record.
        every : int
            Ticks at a time.

        Yields
        ------
        tuple of int and ndarray, (ticks, 4, 3)
            The number of ticks done, and the forces, N.
        """
        self.use_weights_of(record)
        steps = ReplaySteps(record)
        while self._ticks < record.length:
            force = self.replay_step(steps, min(record.length, self._ticks - self._ticks % every + every))
            yield self._ticks, force

    def replay_step(self, steps: ReplaySteps, tick: int) -> Float64:
        """Replay a record up to a tick, or to where before it a model changed or something was marked.

        Parameters
        ----------
        steps : ReplaySteps
            Where the replay stands.
        tick : int
            The tick.

        Returns
        -------
        ndarray, (ticks, 4, 3)
            The forces, N.
        """
        if (change := steps.change_at(self._ticks)) is not None:
            name, sweeps = change
            self.change(steps.model(name, self.tissue, self.first), sweeps)
        if (cut := steps.cut_at(self._ticks)) is not None:
            self.cut_again(cut)
        return self._advance(steps.device, steps.stop(self._ticks, tick) - self._ticks)

    @property
    def ticks(self) -> int:
        """How many ticks it has run without a clock, and in all once it has stopped."""
        return self._ticks

    def _advance(self, commands: Any, ticks: int) -> Float64:
        if self.loop.running:
            raise DataError("step: the session runs by the clock; call stop() first")
        forces = [np.empty((0, TOOLS, 3))]
        for begun in range(0, ticks, 10_000):  # the core's queues are bounded
            forces.append(self.loop.step(commands, min(10_000, ticks - begun)))
            self.events.collect(self.loop)
        self._ticks = int(self.loop.frame().tick)
        return np.concatenate(forces)

    def frame(self) -> Any:
        """Return the newest frame. Call it from one thread only.

        Returns
        -------
        Frame
            tick, late, work (N mm), shown (S, 3) in mm; for each tool contact, force (N), point, displacement and tip (mm);
            for each loose piece piece_state and piece_offset (mm).
        """
        return self.loop.frame()

    @property
    def displacement(self) -> Float64:
        """Displacement of every node, (N, 3), mm. Not while the session runs in real time."""
        if self.loop.running:
            raise DataError("displacement: the session runs by the clock; call stop() first, or look at frame().shown")
        return np.array(self.loop.displacement())

    def record(self) -> Record:
        """Return all commands so far.

        Returns
        -------
        Record
            The record.

        Raises
        ------
        DataError
            If the record has gaps, or the session runs.
        """
        if self.loop.running:
            raise DataError("record: the session runs by the clock; call stop() first")
        if lost := self.loop.dropped():
            raise DataError(
                f"record: {lost} entries were lost, since Python's threads stood still for seconds; record again"
            )
        self.events.collect(self.loop)
        return Record(length=int(self.loop.frame().tick), **self.description(), **self.events.columns())

    def description(self) -> dict[str, Any]:
        """Say what a `Record` holds of the session as a whole.

        Returns
        -------
        dict
            model, tissue, settings, instructions and lesson, as `Record` has them.
        """
        return {**description_of(self.first, self.settings), "lesson": self.lesson}
