"""What the hands of two haptic devices feel at two sites of one room, by the time that the network takes.

    python -m benchmarks.devices_apart [--contacts 12] [--delays 0,50,150,300] [--kills 6]

Both hands are masses on springs. In a third of the contacts they press a few centimetres apart, to and fro; in a third each
holds the organ by its button, and they pull against each other; in a third one holds it softly, and the other one pulls it
about. The network delays each way by so many ms with 20 % jitter; one packet of 1,400 bytes in twenty is held for 200 ms or
1.5 round trips, and all behind it. In virtual time (tests/support/device_sites.py): servos, loops and the room as they run.

Told are, of the worst hand and contact: the greatest force (N); the energy that the hand got, at any time (mJ), and without
the account; the largest change of its force in a tick (% of its greatest); how far its force is from that of `push` with
both hands, once all has come to rest (%); and in how many ticks the force was gone when the room was lost, while the hand
pressed on, and by how much it grew meanwhile (N).

With `--kills` a real server is then killed (SIGKILL) so many times under a hand that presses, of Force Dimension's stand-in
at 1 kHz. Told is in how many of its ticks there was a force after the connection was closed.
"""

import argparse
import asyncio
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.device_sites import LEFT, RADIUS, RIGHT, Contact, World, pressing, pulling
from support.example_organs import organ
from support.fake_devices.bench import Bench, built
from support.running_server import start, until

import palpate as pp
from palpate.rooms.join import ENERGY
from palpate.rooms.room_site import RoomSite
from palpate.rooms.room_way import room_way

ABOVE = np.array([0.0, 0.0, 5.0])
LEAST = 0.05  # N: what is less grazes the tissue, and no step of it counts
SOFT = 0.05  # N/mm
ROUNDS = 4
WITHDRAWN = 40  # ticks that are looked at after the room was lost


def contact(delay: int, seed: int, energy: float) -> tuple[World, list[Contact], float]:
    """A world after one contact of each hand, what they felt, and the error of their forces at rest."""
    rng = np.random.default_rng(1000 * delay + seed)
    world = World(organ(6), [LEFT + ABOVE, RIGHT + ABOVE], delay=delay, seed=seed, energy=energy)  # type: ignore[no-untyped-call]
    # s, until all has arrived, several times: a hand that moves the tissue of the other one moves that hand too
    rest = 3.0 + (ROUNDS * (1.2 * delay + 60 + max(200, 3 * delay)) / 1000 if energy == ENERGY else 0)
    for site, place, side in zip(world.sites, (LEFT, RIGHT), (1, -1), strict=True):
        size, how = (
            8 * rng.uniform(0.7, 1),
            {"tug": rng.uniform(0.5, 1.5), "phase": rng.uniform(0, 6.28), "back": rest + 1.6},
        )
        if seed % 3 == 0:
            site.wish = pressing(place, (0.3 * side, 0, -0.95), size, **how)  # type: ignore[no-untyped-call]
        elif seed % 3 == 1 or side < 0:
            how["swing"] = 0.4 if seed % 3 == 1 else 0.9
            site.wish = pulling(place, (-0.8 * side, 0, 0.6), (1 + seed % 3 // 2) * size, **how)  # type: ignore[no-untyped-call]
        else:
            site.stiffness = SOFT
            site.wish = pulling(place, (0, 0, 1.0), 0, **how)  # type: ignore[no-untyped-call]
    world.run(int(1000 * rest) + 700)  # type: ignore[no-untyped-call]
    error = error_at_rest(world) if energy == ENERGY else 0.0
    world.run(2000 + 2 * delay)  # type: ignore[no-untyped-call]
    return world, [one for site in world.sites for one in site.contacts], error


def error_at_rest(world: World) -> float:
    """Of the worst hand, relative to the force of `push`; of the loop, whose force the account may show in part only."""
    frames = [site.session.frame() for site in world.sites]
    if any(frame.contact[0] != 1 for frame in frames):
        return float("nan")
    points, displacements = ([getattr(frame, name)[0] for frame in frames] for name in ("point", "displacement"))
    pushed = pp.model(organ(6), "compliance").push(points, displacements, RADIUS)
    far = [np.linalg.norm(frame.force[0] - force) for frame, force in zip(frames, pushed.force, strict=True)]
    return float(max(np.array(far) / np.linalg.norm(pushed.force, axis=1)))


def lost(delay: int) -> tuple[int, float]:
    """Ticks until the force was gone, and by how much it grew at most, for a hand that presses on."""
    world = World(organ(6), [LEFT + ABOVE], delay=delay)  # type: ignore[no-untyped-call]
    (site,) = world.sites
    site.wish = pressing(LEFT, (0.0, 0.0, -1.0), 8, still=0.5, back=1e9, swing=0)  # type: ignore[no-untyped-call]
    while np.linalg.norm(site.force) < 0.3:
        world.tick()  # type: ignore[no-untyped-call]
    world.cut = True
    world.down[0].waiting.clear()
    site.hand.lose()
    forces = [float(np.linalg.norm(site.force))]
    for _ in range(WITHDRAWN):
        world.tick()  # type: ignore[no-untyped-call]
        forces.append(float(np.linalg.norm(site.force)))
    return int(np.argmax(np.array(forces) == 0)), max(0.0, float(np.diff(forces[1:]).max()))


def killed(folder: Path) -> int:
    """Ticks with a force after a real server was killed and its connection closed."""
    bench = Bench("libdhd", built(folder, "libdhd"))  # type: ignore[no-untyped-call]
    bench.lower(40.0)  # type: ignore[no-untyped-call]
    pp.write_tissue(folder / "organ.vtu", organ(6))
    server = start("serve organ.vtu --no-browser", folder)  # type: ignore[no-untyped-call]
    address = next(line.split()[1] for line in server.stdout if line.split()[:1] == ["trainee"])
    closed: list[int] = []
    site = RoomSite(room_way(address), lambda text: None)

    async def visit() -> None:
        await site.fetch()
        bench.device = bench.make(energy=ENERGY)  # type: ignore[no-untyped-call]
        site.start(bench.device)
        bench.device.start()
        assert site.hand is not None
        lose = site.hand.lose

        def noted() -> None:
            closed.append(time.monotonic_ns())
            lose()

        site.hand.lose = noted  # type: ignore[method-assign]
        await site.stay(lambda: server.returncode is not None and len(closed) > 0)

    thread = threading.Thread(target=lambda: asyncio.run(visit()))
    thread.start()
    until(lambda: site.hand is not None and site.hand.there and bench.get("ticks") > 200)  # type: ignore[no-untyped-call]
    bench.lower(19.0)  # type: ignore[no-untyped-call]
    until(lambda: bench.get("force") > 0.2)  # type: ignore[no-untyped-call]
    server.kill()
    server.wait()
    thread.join()
    time.sleep(0.1)
    ticks = int(bench.library.stand_in_ticks_with_force_after(closed[0]))
    bench.stop()  # type: ignore[no-untyped-call]
    site.stop()
    return ticks


def row(delay: int, contacts: int) -> str:
    """Of the table."""
    told: list[Any] = [contact(delay, seed, ENERGY) for seed in range(contacts)]
    without = [one for seed in range(contacts) for one in contact(delay, seed, 1e9)[1]]
    felt = [one for _, each, _ in told for one in each]
    step = max(one.step / one.largest for one in felt if one.largest > LEAST)
    gone, grew = lost(delay)
    return (
        f"| {delay} | {max(one.largest for one in felt):.2f} | {max(one.most_energy for one in felt):.2f} | "
        f"{max(one.most_energy for one in without):.2f} | {100 * step:.1f} | {100 * max(each for *_, each in told):.2f} | "
        f"{gone} | {grew:g} |"
    )


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--contacts", type=int, default=12)
    parser.add_argument("--delays", default="0,50,150,300")
    parser.add_argument("--kills", type=int, default=0)
    given = parser.parse_args()
    print("| delay, ms | force, N | energy, mJ | without | % a tick | % from push | gone in ticks | grew, N |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for delay in map(int, filter(None, given.delays.split(","))):
        print(row(delay, given.contacts), flush=True)
    for _ in range(given.kills):
        with tempfile.TemporaryDirectory() as folder:
            print(f"killed: {killed(Path(folder))} ticks with a force", flush=True)


if __name__ == "__main__":
    main()
