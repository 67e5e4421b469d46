"""Cuts by the hands of pages: the way of a blade, and the cuts that follow it while it moves."""

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from starlette.websockets import WebSocket

from palpate.arrays import ArrayLike, Float64
from palpate.errors import PalpateError
from palpate.meshes.tet_mesh import regions_by_size
from palpate.server.held_tools import HeldTools
from palpate.server.message_kinds import CutStep
from palpate.server.messages import Scalpel
from palpate.server.scene_message import reach
from palpate.simulation.cut_bodies import taken_by_name
from palpate.simulation.pointer import Command, ContactState, PieceState
from palpate.simulation.session import RATE, Session
from palpate.tissue.cutting import may_be_cut
from palpate.tissue.cutting_work import CuttingWork
from palpate.tissue.incision import incision, incision_way
from palpate.tissue.tissue import Tissue

SPACING = 0.5  # mean edges between the points of a way
TOLERANCE = 0.1  # mean edges from the way of the hand: each point that is left costs time
PIECE = 1.0  # mean edges by which the way grows until the cut follows
MOST_POINTS = 400  # of a way
MOST_CUTS = 100  # changes of the body in a session, whose cost grows with their number
RETRY = 0.005  # s, while an earlier change is on its way
DEPTH = 2.5  # mean edges, of a cut at first
TOOL = 0  # that the loop has as the blade: it presses or pulls otherwise


@dataclass(eq=False)
class Stroke:
    """One stroke of a blade. page: whose it is; None: the device's with motors. before: the tissue before it. direction: of
    the blade; None: against the surface. cut: how many points of the way the cut has followed.
    """

    page: WebSocket | None
    session: Session
    before: Tissue
    depth: float
    way: list[tuple[float, float, float]]
    direction: tuple[float, float, float] | None = None
    ended: bool = False
    cut: int = 0
    moved: asyncio.Event = field(default_factory=asyncio.Event)

    def add(self, point: tuple[float, float, float], last: bool) -> None:
        """Goes on to a point, mm."""
        far = np.linalg.norm(np.subtract(point, self.way[-1])) >= SPACING * self.before.edge
        if far and len(self.way) < MOST_POINTS:
            self.way.append(point)
        self.ended = self.ended or last
        self.moved.set()

    def edge(self) -> tuple[float, float, float]:
        """Of the blade, from the surface into the tissue, mm, as it has entered: later points may lie anywhere."""
        way = incision_way(self.before, self.way[:1], self.direction)
        return tuple((self.depth * way).tolist())

    @property
    def due(self) -> bool:
        """Whether the cut is to follow."""
        grown = np.linalg.norm(np.subtract(self.way[-1], self.way[max(self.cut - 1, 0)]))
        return len(self.way) > max(self.cut, 1) and (self.ended or bool(grown >= PIECE * self.before.edge))


class Cutting:
    """Used on the event loop's thread only. One stroke at a time, of one page.

    lock: of whoever changes the session. present: the session that runs; a stroke ends with its own. changed: called after
    each cut. tell: shows a text in every page. tools: the loop's, one of which feels as the blade does.
    """

    def __init__(
        self,
        lock: asyncio.Lock,
        present: Callable[[], Session],
        changed: Callable[[], None],
        tell: Callable[..., Coroutine[Any, Any, None]],
        tools: HeldTools | None = None,
    ) -> None:
        self.lock, self.present, self.changed, self.tell = lock, present, changed, tell
        self.tools = tools
        self.stroke: Stroke | None = None
        self.failed = False  # the device's last stroke, which it has not ended yet
        self.pieces: tuple[int, list[PieceState]] = (0, [])  # the body, and where its pieces were last

    def obey(self, page: WebSocket, session: Session, message: Scalpel) -> "asyncio.Task[None] | None":
        """Begins, goes on with or ends a stroke, or takes a cut back; returns the task that was begun for it."""
        stroke = self.stroke
        if message.step == CutStep.undo:
            return None if stroke else asyncio.create_task(self._undo(session))
        if stroke is None:
            if message.step != CutStep.begin:
                return None
            depth = min(message.depth, 2 * reach(session))  # through all of it
            way = message.direction if any(message.direction) else None
            self.stroke = Stroke(page, session, session.tissue, depth, [message.point], way)
            self._feel(self.stroke, message.point)
            return asyncio.create_task(self._follow(self.stroke))
        if message.step == CutStep.begin:
            told = "Another cut goes on: wait until it has ended."
            return None if stroke.page is page else asyncio.create_task(self.tell(told, page))
        if stroke.page is page:
            stroke.add(message.point, message.step == CutStep.end)
            self._feel(stroke, message.point)
        return None

    def follow(self, session: Session, frame: Any) -> "asyncio.Task[None] | None":
        """Cuts behind the blade of a device with motors, whose way frames tell; returns the task that was begun for it."""
        stroke, cuts = self.stroke, frame.contact[TOOL] == ContactState.cutting
        self.failed = self.failed and cuts
        if stroke is None and cuts and not self.failed:
            depth = min(first_depth(session), 2 * reach(session))
            self.stroke = Stroke(None, session, session.tissue, depth, [tuple(frame.point[TOOL])])
            return asyncio.create_task(self._follow(self.stroke))
        if stroke and stroke.page is None:
            stroke.add(tuple(frame.point[TOOL]) if cuts else stroke.way[-1], last=not cuts)
        return None

    def watch_pieces(self, session: Session, frame: Any) -> "asyncio.Task[None] | None":
        """Tells what a hand has lifted out, once it has let go; returns the task that was begun for it."""
        (body, before), now = self.pieces, list(frame.piece_state)
        self.pieces = frame.body, now
        if not (body == frame.body == session.bodies):
            return None
        out = [
            piece.volume
            for piece, was, is_now in zip(session.pieces, before, now, strict=True)
            if was == PieceState.carried and is_now in (PieceState.falling, PieceState.gone)
        ]
        return (
            asyncio.create_task(self.tell(f"{in_ml(sum(out))} lifted out at {frame.tick / RATE:.1f} s."))
            if out
            else None
        )

    def _feel(self, stroke: Stroke, point: tuple[float, float, float]) -> None:
        """The loop's blade goes to a point, or out of the tissue once the stroke has ended."""
        if self.tools and stroke.page:
            cutting = Command(True, point, stroke.edge(), "blade")
            self.tools.go_on(stroke.page, TOOL, Command() if stroke.ended else cutting)

    def leave(self, page: WebSocket) -> None:
        """Ends the stroke of a page that has gone."""
        if self.stroke and self.stroke.page is page:
            self.stroke.ended = True
            self.stroke.moved.set()

    async def _follow(self, stroke: Stroke) -> None:
        try:
            if stroke.session.bodies >= MOST_CUTS:
                await self.tell(f"the organ was cut, or a cut taken back, {MOST_CUTS} times; begin another session")
                return
            while not stroke.ended or stroke.due:
                if not stroke.due:
                    await stroke.moved.wait()
                    stroke.moved.clear()
                    continue
                done = len(stroke.way)
                way = simplified(stroke.way[:done], TOLERANCE * stroke.before.edge)
                blade = await asyncio.to_thread(incision, stroke.before, way, stroke.depth, stroke.direction)
                cut = partial(stroke.session.cut, blade, extend=stroke.cut > 0)
                if not await self._change(stroke.session, cut):
                    return
                stroke.cut = done
            if stroke.cut:
                length = float(np.linalg.norm(np.diff(stroke.way[: stroke.cut], axis=0), axis=1).sum())
                work = told(stroke.session.cutting_work[-1], length)
                await self.tell(work + told_of_pieces(stroke.session, stroke.before), stroke.page)
        except PalpateError as problem:
            await self.tell(str(problem))
        finally:
            if not stroke.ended:  # it is refused: the blade comes out. One that has ended may press by now
                self.failed = stroke.page is None
                stroke.ended = True
                self._feel(stroke, stroke.way[-1])
            self.stroke = None

    async def undo_all(self, session: Session) -> None:
        """Takes all cuts of the session back."""
        while session.cuts and session is self.present():
            await self._undo(session)

    async def _undo(self, session: Session) -> None:
        try:
            await self._change(session, session.undo)
        except PalpateError as problem:
            await self.tell(str(problem))

    async def _change(self, session: Session, change: Callable[[], bool]) -> bool:
        """Changes a session, once earlier changes are done; False if it is not the one that runs any more."""
        async with self.lock:
            if session is not self.present():
                return False
            while not await asyncio.to_thread(change):
                await asyncio.sleep(RETRY)
            self.changed()
            return True


def told(work: CuttingWork, way: float) -> str:
    """What the hand on a blade has done along a way of so many mm."""
    size = f"Cut of {work.area:.0f} mm²"
    if work.unknown and not work.total:
        return f"{size}, of unknown toughness."
    return f"{size}: {work.total:.1f} mJ, {work.total / way:.2f} N on the blade."


def told_of_pieces(session: Session, before: Tissue) -> str:
    """What of the organ has come free since a tissue of the session, and how much of each part inside is out by now."""
    taken, earlier = session.taken, taken_by_name(before)
    new = sum(taken.values()) - sum(earlier.values())
    if not new > 0:
        return ""
    mesh = session.first.tissue.mesh
    whole = np.bincount(mesh.region, mesh.volumes)
    inner = [(label, (mesh.names or {}).get(label, f"region {label}")) for label in regions_by_size(mesh)[1:]]
    out = [f"{taken[name] / whole[label]:.0%} of {name}" for label, name in inner if name in taken]
    return f" {in_ml(new)} came free{': ' if out else ''}{', '.join(out)}. Pull or Grasp takes it out."


def in_ml(volume: float) -> str:
    """A volume, mm³, in words."""
    return f"{float(f'{volume / 1000:.2g}'):g} ml"


def simplified(way: ArrayLike, tolerance: float) -> Float64:
    """Points (p, 3) of a way such that no point left out is more than `tolerance` mm from the line between its neighbours.

    D. H. Douglas & T. K. Peucker, Cartographica 10 (1973) 112.
    """
    points = np.asarray(way, dtype=np.float64)
    kept, parts = {0, len(points) - 1}, [(0, len(points) - 1)]
    while parts:
        a, b = parts.pop()
        along = points[b] - points[a]
        offset = points[a + 1 : b] - points[a]
        share = np.clip(offset @ along / max(float(along @ along), 1e-12), 0, 1)
        far = np.linalg.norm(offset - share[:, None] * along, axis=1)
        if len(far) and far.max() > tolerance:
            middle = a + 1 + int(np.argmax(far))
            kept.add(middle)
            parts += [(a, middle), (middle, b)]
    return points[sorted(kept)]


def may_cut(session: Session) -> bool:
    """Whether pages may cut the tissue of a session."""
    tissue = session.first.tissue
    return may_be_cut(tissue) and not tissue.time_dependent and not taken_by_name(tissue)


def first_depth(session: Session) -> float:
    """mm, of a cut at first."""
    mesh = session.first.tissue.mesh
    return float(min(DEPTH * session.first.tissue.edge, np.ptp(mesh.nodes, axis=0).min() / 2))
