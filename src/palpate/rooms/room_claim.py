"""Which host keeps a room open: this one alone, or the one of several that has claimed it."""

import asyncio
import contextlib
import json
import zlib
from dataclasses import dataclass, field

from palpate.errors import DataError
from palpate.rooms.registry import BEAT, MOST_BYTES, Registry, RegistryLost
from palpate.rooms.room_process import RoomProcess

LEFT = 4 * BEAT  # s for which a free room is left to a host with fewer


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


async def hold(room: RoomProcess, host: Host, share: Share) -> None:
    """Keeps a room open while this host has it, until this is cancelled.

    A host that has its share of the rooms leaves a free one to others for a while, and gives up one that is too many once
    nobody is in it. While the registry does not answer, all stays as it is: whoever has a room keeps it. If another host has
    claimed it meanwhile, that one goes on with it, and this one ends its own.
    """
    name, registry, now = room.room.name, host.registry, asyncio.get_running_loop().time
    opened: asyncio.Task[None] | None = None
    answers = True
    taken = now()  # when another host was last seen to have it, or to be about to
    try:
        while True:
            try:
                wants = opened is not None or not share.full or now() - taken > LEFT
                owner = await (registry.claim(name, host.name) if wants else registry.owner(name))
                if owner == host.name and opened is None:
                    share.held.add(name)
                    room.state = unpacked(await registry.kept(name))
                    room.elsewhere = ""
                    opened = asyncio.create_task(keep_open(room))
                elif owner not in ("", host.name):
                    taken = now()
                    if opened is not None:
                        print(f"palpate: room {name} is on another host now; it ends here", flush=True)
                        share.held.discard(name)
                        await ended(opened)
                        opened = None
                    room.move(owner.partition(" ")[2])
                if opened is not None and room.news.is_set():
                    await tell(room, host)
                if not answers:
                    print("palpate: the registry answers again", flush=True)
                answers = True
            except RegistryLost as problem:
                if answers:
                    print(f"palpate: the registry does not answer ({problem}); rooms stay where they are", flush=True)
                answers = False
            if opened is not None and opened.done():  # it cannot be opened here
                await give_up(room, host, share, opened)
                opened = None
                await asyncio.sleep(10 * BEAT)  # another host may try
            elif opened is not None and answers and share.too_many and room.port and not room.people:
                print(f"palpate: room {name} goes to another host, since nobody is in it", flush=True)
                await give_up(room, host, share, opened)
                opened, taken = None, now()
            if answers:
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(room.news.wait(), BEAT)
            else:
                await asyncio.sleep(BEAT)
    finally:
        if opened is not None:
            await give_up(room, host, share, opened)


async def give_up(room: RoomProcess, host: Host, share: Share, opened: "asyncio.Task[None]") -> None:
    """Ends a room that was kept open, has what it holds kept, and lets other hosts have it."""
    share.held.discard(room.room.name)
    await ended(opened)
    with contextlib.suppress(RegistryLost):
        await tell(room, host)
        await host.registry.release(room.room.name, host.name)


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
