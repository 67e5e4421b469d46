"""Which host keeps a room open: this one alone, or the one of several that has claimed it."""

import asyncio
import contextlib
import json
import zlib
from dataclasses import dataclass

from palpate.errors import DataError
from palpate.rooms.registry import BEAT, MOST_BYTES, Registry, RegistryLost
from palpate.rooms.room_process import RoomProcess


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


async def hold(room: RoomProcess, host: Host) -> None:
    """Keeps a room open while this host has it, until this is cancelled.

    While the registry does not answer, all stays as it is: whoever has a room keeps it. If another host has claimed it
    meanwhile, that one goes on with it, and this one ends its own.
    """
    name, registry = room.room.name, host.registry
    opened: asyncio.Task[None] | None = None
    answers = True
    try:
        while True:
            try:
                owner = await registry.claim(name, host.name)
                if owner == host.name and opened is None:
                    room.state = unpacked(await registry.kept(name))
                    room.elsewhere = ""
                    opened = asyncio.create_task(keep_open(room))
                elif owner != host.name:
                    if opened is not None:
                        print(f"palpate: room {name} is on another host now; it ends here", flush=True)
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
                await ended(opened)
                opened = None
                with contextlib.suppress(RegistryLost):
                    await registry.release(name, host.name)
                await asyncio.sleep(10 * BEAT)  # another host may try
            if answers:
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(room.news.wait(), BEAT)
            else:
                await asyncio.sleep(BEAT)
    finally:
        if opened is not None:
            await ended(opened)
            with contextlib.suppress(RegistryLost):
                await tell(room, host)
                await registry.release(name, host.name)


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
