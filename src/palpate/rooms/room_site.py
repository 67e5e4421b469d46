"""A haptic device at one site of a room: its loop, its servo, and the connection to the room, which it makes again."""

import asyncio
import contextlib
import json
import struct
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed

from palpate import _core
from palpate.errors import DataError
from palpate.haptics.haptic_device import Haptic
from palpate.rooms.room_hand import RoomHand, WayLength
from palpate.rooms.room_way import ALIVE, NotComputed, RoomAway, RoomWay
from palpate.rooms.solid_reader import RoomOrgan, read_organ
from palpate.server.message_kinds import CloseCode, Role
from palpate.server.messages import BINARY, Detail, Frame, Hands, People, Seen, code, decode_told, encode
from palpate.simulation.session import Session

COMMANDS = 0.016  # s between the commands of a hand
SEEN = 0.1  # s between the messages that say how many frames have come
PINGS = 0.25  # s between measurements of the way
RETRY = 0.1  # s, while an earlier change of the organ is under way
FIRST_PAUSE, LAST_PAUSE = 0.25, 4.0  # s before it connects again
NO_HANDS = np.empty((0, 13), np.float32)


class RoomSite:
    """Used on the event loop's thread only.

    way: into the room. say: shows the person a line. device: opened, not started. session: computes the room's organ.
    way_length: there and back.
    """

    def __init__(self, way: RoomWay, say: Callable[[str], None]) -> None:
        self.way, self.say = way, say
        self.device: Haptic | None = None
        self.session: Session | None = None
        self.hand: RoomHand | None = None
        self.way_length = WayLength()
        self._organ: RoomOrgan | None = None
        self._data = b""
        self._body = self._model = self._refused = -1
        self._lost = False  # there is no loop for the organ
        self._depth = 0.0  # mm of a blade
        self._seen = 0
        self._there = False
        self._left = False  # a connection, and the organ may be another one since
        self._change: asyncio.Task[None] | None = None

    async def fetch(self) -> None:
        """The room's organ as it is now. Raises `DataError` if no hand can touch it from here, `RoomAway`."""
        scene = await self.way.scene()
        if scene.get("replay"):
            raise DataError("the room shows a recorded session, which no hand can touch")
        if scene.get("exam"):
            raise DataError(
                "the room is an exam: a site that computes the force would know what is inside; take it in a page"
            )
        data = await self.way.solid()
        self._depth = float(scene.get("depth", 0)) if "cut" in scene.get("tools", ()) else 0.0
        names = list(scene.get("models", ()))
        self._body, self._model = (
            scene.get("body", -1),
            names.index(scene["model"]) if scene.get("model") in names else -1,
        )
        if self._organ is None or data != self._data:
            await self._take(await asyncio.to_thread(read_organ, data))
        self._data = data

    async def _take(self, organ: RoomOrgan) -> None:
        """The loop goes on with the organ, which was cut or a cut taken back; or begins with it, and the hand begins anew."""
        before, self._organ = self._organ, None  # until the session has become this one
        steps = None if self.session is None or before is None else organ.cuts_from(before, self.session)
        if steps is None:
            await self._begin_with(organ)
        for step in steps or ():
            while not await asyncio.to_thread(step):
                await asyncio.sleep(RETRY)
        self._organ = organ

    async def _begin_with(self, organ: RoomOrgan) -> None:
        """Another loop, and the hand begins anew."""
        self._lost = True
        if self.hand is not None:
            self.hand.lose()
        after = await asyncio.to_thread(organ.session)
        before, self.session = self.session, after
        if before is not None:
            await asyncio.to_thread(before.stop)
        if self.device is not None:
            self._begin(after)
        self._lost = False

    def start(self, device: Haptic) -> None:
        """The loop runs for this device from now on; its servo has to be started."""
        assert self.session is not None
        self.device = device
        self._begin(self.session)

    def _begin(self, session: Session) -> None:
        assert self.device is not None
        self.device.core = _core.haptics.RoomDevice(self.device.servo)
        session.start(self.device)
        if self.hand is None:
            self.hand = RoomHand(session, self.device.core)
        else:
            self.hand.renew(session, self.device.core)
        self.hand.depth = self.device.core.edge = self._depth

    def stop(self) -> None:
        """The loop ends, and the last force is zero."""
        if self.session is not None:
            self.session.stop()

    async def stay(self, ended: Callable[[], bool]) -> None:
        """In the room until it has ended. Raises `DataError` if the room lets nobody in with this invitation."""
        over = asyncio.create_task(self._until(ended))
        pause, told = FIRST_PAUSE, ""
        while not over.done():
            visit = asyncio.create_task(self._visit())
            await asyncio.wait((visit, over), return_when=asyncio.FIRST_COMPLETED)
            visit.cancel()
            try:
                with contextlib.suppress(asyncio.CancelledError):
                    await visit
            except (RoomAway, NotComputed) as problem:
                if self._there or str(problem) != told:
                    told = str(problem)
                    self.say(f"{told}; the force is off, trying again")
            pause = FIRST_PAUSE if self._there else min(2 * pause, LAST_PAUSE)
            self._there = False
            await asyncio.wait((over,), timeout=pause)
        await over

    @staticmethod
    async def _until(ended: Callable[[], bool]) -> None:
        while not ended():
            await asyncio.sleep(0.05)

    async def _visit(self) -> None:
        """One connection, until it is lost."""
        assert self.hand is not None
        if self._left:
            await self.fetch()
        self._left = True
        async with self.way.messages() as socket:
            self.way_length, self._seen = WayLength(), 0
            tasks = [
                asyncio.create_task(work) for work in (self._receive(socket), self._send(socket), self._measure(socket))
            ]
            try:
                await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            finally:
                self.hand.lose()
                ends = [*tasks, *([self._change] if self._change else [])]
                for task in ends:
                    task.cancel()
                results = await asyncio.gather(*ends, return_exceptions=True)
                self._change = None
        for result in results:
            if isinstance(result, Exception):
                raise result

    async def _receive(self, socket: ClientConnection) -> None:
        assert self.hand is not None
        hands = NO_HANDS
        try:
            while True:
                async with asyncio.timeout(ALIVE):
                    data = await socket.recv()
                if isinstance(data, str):
                    self.say(data)
                    continue
                kind = BINARY[data[0] - 1]
                if kind is Hands:
                    hands = np.frombuffer(data, "<f4", offset=_size(Hands)).reshape(-1, 13)
                elif kind is People:
                    self._people(data)
                elif kind is Frame:
                    self._seen += 1
                    self._frame(decode_told(Frame, data), hands)
        except TimeoutError:
            raise RoomAway(f"no word of the room for {ALIVE:g} s") from None
        except ConnectionClosed as closed:
            self.hand.lose()  # before anything else
            _leave(closed)
        finally:
            self.hand.lose()

    def _people(self, data: bytes) -> None:
        assert self.hand is not None
        told = decode_told(People, data)
        me = next(person for person in json.loads(data[_size(People) :]) if person["number"] == told.you)
        role = Role(me["role"])
        if role == Role.viewer:
            raise DataError("the invitation is a viewer's, who may not touch; ask the teacher for a trainee's")
        if not self._there:
            self._there = True
            self.say(f"in the room as {me['name']} ({role.name})")
        if self.hand.stopped != (told.frozen and role != Role.teacher):
            self.say("the teacher has stopped all hands" if told.frozen else "hands may go on")
        self.hand.people(bool(told.frozen), role)

    def _frame(self, frame: Frame, hands: Any) -> None:
        assert self.hand is not None
        followed = frame.model == frame.chosen == self._model
        if followed and frame.body != self._body and self._change is None:
            self._change = asyncio.create_task(self._follow(frame.body))
        if followed and frame.body != self._refused:
            if not self._lost:
                self.hand.hear(frame, hands)
        elif self.hand.there:
            self.hand.lose()
            self.say("the room answers with another model, which is not computed here; the force is off")

    async def _follow(self, body: int) -> None:
        """The organ was cut, or a cut taken back."""
        try:
            await self.fetch()
            self._refused = -1
        except RoomAway:
            self._body = -1  # it is asked again
            await asyncio.sleep(RETRY)
        except DataError as problem:
            self._body = self._refused = body
            self.say(f"{problem}; the force is off")
        finally:
            self._change = None

    async def _send(self, socket: ClientConnection) -> None:
        assert self.hand is not None
        seen, at = 0, time.monotonic()
        with contextlib.suppress(ConnectionClosed):
            await socket.send(encode(Detail(0)))
            while True:
                await asyncio.sleep(COMMANDS)
                self.hand.patience = self.way_length.patience
                for message in (self.hand.command(), self.hand.scalpel()):
                    if message:
                        await socket.send(encode(message))
                if self._seen != seen and time.monotonic() - at > SEEN:
                    seen, at = self._seen, time.monotonic()
                    await socket.send(encode(Seen(seen)))
            return
        await asyncio.Future()  # _receive says why it has closed

    async def _measure(self, socket: ClientConnection) -> None:
        with contextlib.suppress(ConnectionClosed):
            while True:
                self.way_length.took(await (await socket.ping()))
                await asyncio.sleep(PINGS)
        await asyncio.Future()


def _size(kind: type) -> int:
    return struct.calcsize(code(kind))


def _leave(closed: ConnectionClosed) -> None:
    """Raises what a close of the room's says; nothing where it is to be fetched again at once."""
    told = closed.rcvd
    number, reason = (told.code, told.reason) if told else (None, "")
    if number == CloseCode.scene_changed:
        return
    if number in (CloseCode.refused, CloseCode.too_many_pages):
        raise DataError(f"not let in: {reason}")
    raise RoomAway(reason or "the connection was closed")
