"""Which host keeps a room open: this one alone, or the one of several that has claimed it."""

import asyncio
import contextlib
import json
import zlib
from dataclasses import dataclass, field

from palpate.errors import DataError
from palpate.rooms.registry import BEAT, MOST_BYTES, Registry, RegistryLost
from palpate.rooms.room_process import RoomProcess

SILENT = 2 * BEAT  # s for which a claim that has run out is left to the host that had it, which may just be late
LEFT = SILENT + 4 * BEAT  # s for which a free room is left to a host with fewer


@dataclass(frozen=True)
class Host:
    """One of several hosts. address: where the others reach it. mark: tells it from one that had the address before."""

    registry: Registry
    address: str
    mark: str

    @property
    def name(self) -> str:
        """As the registry knows it."""
        return f"{self.mark} {self.address}"


async def keep_open(room: RoomProcess) -> None:
    """Keeps a room open until this is cancelled, then ends it. One that cannot be opened says why by its `problem`."""
    try:
        with contextlib.suppress(DataError):
            await room.open()
            await room.keep()
    finally:
        await asyncio.shield(room.close())


@dataclass(eq=False)
class Share:
    """How many rooms there are, how many hosts, and which rooms this one has. Used on the event loop's thread only."""

    rooms: int
    hosts: int = 1
    held: set[str] = field(default_factory=set)

    @property
    def full(self) -> bool:
        """Whether this host has as many rooms as each should."""
        return len(self.held) * self.hosts >= self.rooms

    @property
    def too_many(self) -> bool:
        """Whether another host should have one of them."""
        return (len(self.held) - 1) * self.hosts >= self.rooms


async def count_hosts(host: Host, share: Share) -> None:
    """Says that this host is there and counts all, until this is cancelled."""
    while True:
        with contextlib.suppress(RegistryLost):
            share.hosts = max(1, await host.registry.hosts(host.name))
        await asyncio.sleep(BEAT)


class RoomClaim:
    """The claim of a host to a room. Used on the event loop's thread only.

    answers: whether the registry did, last time.
    """

    def __init__(self, room: RoomProcess, host: Host, share: Share) -> None:
        self.room, self.host, self.share = room, host, share
        self.answers = True
        self._opened: asyncio.Task[None] | None = None  # keeps the room open while this host has it
        self._now = asyncio.get_running_loop().time
        self._seen_elsewhere = False  # whether another host was ever seen to have it
        self._free_since: float | None = self._now()  # when it was first seen free, or None while another host has it

    @property
    def failed(self) -> bool:
        """Whether the room cannot be opened here."""
        return self._opened is not None and self._opened.done()

    @property
    def too_many(self) -> bool:
        """Whether another host should have the room, and nobody is in it."""
        here = self._opened is not None and self.room.port != 0
        return here and self.answers and self.share.too_many and not self.room.people

    async def renew(self) -> None:
        """Claims the room or renews the claim, and does as the registry says. Without an answer all stays as it is."""
        try:
            await self._follow(await self._owner())
            if self._opened is not None and self.room.news.is_set():
                await tell(self.room, self.host)
        except RegistryLost as problem:
            if self.answers:
                print(f"palpate: the registry does not answer ({problem}); rooms stay where they are", flush=True)
            self.answers = False
        else:
            if not self.answers:
                print("palpate: the registry answers again", flush=True)
            self.answers = True

    async def _owner(self) -> str:
        """The host that has the room, which may be this one if it wants it. Raises `RegistryLost`."""
        registry, name = self.host.registry, self.room.room.name
        wait = LEFT if self.share.full else SILENT if self._seen_elsewhere else 0.0
        free = self._free_since is not None and self._now() - self._free_since >= wait
        if self._opened is not None or free:
            return await registry.claim(name, self.host.name)
        return await registry.owner(name)

    async def _follow(self, owner: str) -> None:
        """Opens the room if it is this host's now, or ends it if it is another's. Raises `RegistryLost`."""
        room, name = self.room, self.room.room.name
        if owner == self.host.name and self._opened is None:
            self.share.held.add(name)
            room.state = unpacked(await self.host.registry.kept(name))
            room.elsewhere = ""
            self._opened = asyncio.create_task(keep_open(room))
        elif not owner:
            self._free_since = self._now() if self._free_since is None else self._free_since
        elif owner != self.host.name:
            self._seen_elsewhere, self._free_since = True, None
            if self._opened is not None:
                print(f"palpate: room {name} is on another host now; it ends here", flush=True)
                self.share.held.discard(name)
                await ended(self._opened)
                self._opened = None
            room.move(owner.partition(" ")[2])

    async def give_up(self) -> None:
        """Ends the room if it is here, has what it holds kept, and lets other hosts have it."""
        if self._opened is None:
            return
        name = self.room.room.name
        self.share.held.discard(name)
        await ended(self._opened)
        with contextlib.suppress(RegistryLost):
            await tell(self.room, self.host)
            await self.host.registry.release(name, self.host.name)
        self._opened, self._free_since = None, self._now()

    async def wait(self) -> None:
        """Until the claim is to be renewed, or the room has news that the registry would take."""
        if not self.answers:
            await asyncio.sleep(BEAT)
            return
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self.room.news.wait(), BEAT)


async def hold(room: RoomProcess, host: Host, share: Share) -> None:
    """Keeps a room open while this host has it, until this is cancelled.

    A host that has its share of the rooms leaves a free one to others for a while, and gives up one that is too many once
    nobody is in it. All leave a room to the host that had it for a while: if the registry stood still, or has forgotten who
    has which, that one claims it again, and nobody in it is disturbed. While the registry does not answer, all stays as it
    is: whoever has a room keeps it. If another host has claimed it meanwhile, that one goes on with it, and this one ends its
    own.
    """
    claim = RoomClaim(room, host, share)
    try:
        while True:
            await claim.renew()
            if claim.failed:
                await claim.give_up()
                await asyncio.sleep(10 * BEAT)  # another host may try
            elif claim.too_many:
                print(f"palpate: room {room.room.name} goes to another host, since nobody is in it", flush=True)
                await claim.give_up()
            await claim.wait()
    finally:
        await claim.give_up()


async def ended(task: "asyncio.Task[None]") -> None:
    """Ends a room that was kept open."""
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task


async def tell(room: RoomProcess, host: Host) -> None:
    """Has what the room holds kept. Raises `RegistryLost`."""
    room.news.clear()
    packed = zlib.compress(json.dumps(room.state).encode())
    if len(packed) > MOST_BYTES:
        print(
            f"palpate: room {room.room.name} has more cuts than the registry keeps; its last ones are not kept",
            flush=True,
        )
        return
    try:
        await host.registry.keep(room.room.name, host.name, packed)
    except RegistryLost:
        room.news.set()  # told later
        raise


def unpacked(kept: bytes) -> dict[str, object] | None:
    """What was kept of a room, or None."""
    return json.loads(zlib.decompress(kept)) if kept else None
