"""What two hands at two sites feel in one room, by the time that the network takes, with prediction in the pages and without.

    python -m benchmarks.rooms_apart [--contacts 20] [--delays 0,50,150,300] [--chromium 5]

Both hands are masses on springs that hold the organ a few centimetres apart and pull against each other, to and fro. The
network delays each way by so many ms with 20 % jitter; one packet of 1,400 bytes in twenty is held for 200 ms or 1.5
round trips, and all behind it. Most of the table is in virtual time (tests/support/two_sites.mjs): the workers of the pages
as they are installed, the room's engine, and the network, so that every tick is seen. With `--chromium` so many contacts of
each delay follow in two real Chromiums, a real room and a real proxy between them, seen frame by frame.

Told are, of the worst hand and contact: the energy that it got from the tissue (mJ), the largest change of its force in
a tick, and from frame to frame (in % of its largest force); and how far apart the organs were that both saw once the
hands had come to rest, 200 ms after the delay (mm).
"""

import argparse
import contextlib
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.browser import PLAIN, draw_plainly, launched
from support.delayed_link import delayed_link
from support.example_organs import organ
from support.open_rooms import open_rooms
from support.touch_page import Touched
from support.two_sites import RADIUS, two_sites

import palpate as pp

POINTS = [[-10.0, 0.0, 25.0], [10.0, 0.0, 25.0]]  # mm
DIRECTIONS = [[-0.8, 0.0, 0.6], [0.8, 0.0, 0.6]]
STILL = 3.0  # s of a contact, after which the hands come to rest
SMALL = {"width": 420, "height": 320}  # pixels: the processor draws, and the hand is at the rate of the pictures
HAND = """([point, direction, size, tug, phase, still, back]) => {
    const MASS = 0.1, STIFFNESS = 0.5, DAMPING = 1.4 * Math.sqrt(MASS * STIFFNESS * 1000) / 1000;
    const hand = window.hand = { energy: 0, largest: 0, step: 0, done: false };
    const x = [0, 0, 0], v = [0, 0, 0], began = performance.now(), drawn = palpate.framesDrawn;
    let ticks = 0, before = null, sent = 0;
    const timer = setInterval(() => {
        const held = palpate.frame.contact[0] === 1, force = held ? palpate.frame.force.slice(0, 3) : [0, 0, 0];
        if (before && held) hand.step = Math.max(hand.step, Math.hypot(...force.map((f, k) => f - before[k])));
        before = held ? force : null;
        hand.largest = Math.max(hand.largest, Math.hypot(...force));
        for (; ticks < performance.now() - began; ticks++) {
            const s = ticks / 1000, ramp = Math.max(0, Math.min(1, s / 0.5, (back - s) / 0.5));
            const way = size * ramp * (1 + 0.4 * Math.sin(6.28 * tug * Math.min(s, still - 0.5) + phase));
            for (let k = 0; k < 3; k++) {
                v[k] += (STIFFNESS * (direction[k] * way - x[k]) - DAMPING * v[k] + force[k]) / MASS;
                const moved = v[k] * 1e-3;
                x[k] += moved;
                hand.energy += force[k] * moved;
            }
        }
        if (!hand.seen && ticks / 1000 > back - 0.5) hand.seen = palpate.positions();
        const now = performance.now();
        if (now - sent < 16) return;
        sent = now;
        if (ticks / 1000 < back + 0.4) return palpate.hold(0, point, [...x]);
        palpate.release(0);
        clearInterval(timer);
        hand.pictures = (palpate.framesDrawn - drawn) / (ticks / 1000);
        hand.done = true;
    }, 4);
}"""


def row(name: str, delay: int, predicted: bool, felt: list[dict[str, float]], step: str, apart: list[float]) -> str:
    """Of the table."""
    energy = max(one["energy"] for one in felt)
    share = max(one["step"] / one["largest"] for one in felt)
    steps = {"tick": "–", "frame": "–", step: f"{100 * share:.1f}"}
    return (
        f"| {name} | {delay} | {'yes' if predicted else 'no'} | {len(felt)} | {max(one['largest'] for one in felt):.2f} | "
        f"{energy:.2f} | {steps['tick']} | {steps['frame']} | {max(apart):.2f} |"
    )


def in_virtual_time(delay: int, predicted: bool, contacts: int) -> str:
    """A row."""
    with tempfile.TemporaryDirectory() as name:
        told = two_sites(
            organ(6),
            Path(name),
            POINTS,
            DIRECTIONS,
            delay=delay,
            predict=predicted,
            contacts=contacts,
            seed=100 + delay,
        )
    felt = [contact for hand in told["hands"] for contact in hand]
    return row("virtual time", delay, predicted, felt, "tick", [one["sites"] for one in told["apart"]])


@contextlib.contextmanager
def two_pages(chromium: Any, delay: int, predicted: bool) -> Iterator[list[Any]]:
    """Two pages in one room, each behind a link of its own."""
    with contextlib.ExitStack() as closing:
        folder = Path(closing.enter_context(tempfile.TemporaryDirectory()))
        pp.write_tissue(folder / "organ.vtu", organ(9))
        room = pp.RoomFile("far", (folder / "organ.vtu",), model="compliance", radius=RADIUS)
        rooms = closing.enter_context(open_rooms([room], folder))
        pages = []
        for k in range(2):
            address = urlsplit(rooms.address("far", "trainee"))
            link = closing.enter_context(delayed_link(address.port, delay / 1000, seed=k))
            page = Touched(None, chromium.new_page(viewport=SMALL))  # type: ignore[no-untyped-call]
            closing.callback(page.page.context.close)
            page.open(address._replace(netloc=f"{address.hostname}:{link.port}").geturl())  # type: ignore[no-untyped-call]
            page.wait("document.querySelectorAll('#people li').length > 0")  # type: ignore[no-untyped-call]
            if predicted:
                page.page.locator("#predict").click()
                page.wait("document.getElementById('predict').textContent === 'Predict'")  # type: ignore[no-untyped-call]
            pages.append(page)
        yield pages


def in_chromium(chromium: Any, delay: int, predicted: bool, contacts: int) -> str:
    """A row."""
    rng = np.random.default_rng(delay)
    felt: list[dict[str, float]] = []
    apart: list[float] = []
    settling = STILL + 2.4 * delay / 1000 + 0.2 + max(0.2, 3 * delay / 1000)
    with two_pages(chromium, delay, predicted) as pages:
        for _ in range(contacts):
            for page, point, direction in zip(pages, POINTS, DIRECTIONS, strict=True):
                size, tug, phase = 8 * rng.uniform(0.7, 1), rng.uniform(0.5, 1.5), rng.uniform(0, 6.28)
                page.page.evaluate(HAND, [point, direction, size, tug, phase, STILL, settling + 0.9])
            told = []
            for page in pages:
                page.wait("hand.done")
                told.append(page.see("hand"))
            felt.extend(told)
            first, second = (np.reshape(one["seen"], (-1, 3)) for one in told)
            apart.append(float(np.linalg.norm(first - second, axis=1).max()))
            time.sleep(1 + 6 * delay / 1000)
    pictures = np.median([one["pictures"] for one in felt])
    return row(f"Chromium, {pictures:.0f} pictures/s", delay, predicted, felt, "frame", apart)


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--contacts", type=int, default=20)
    parser.add_argument("--delays", default="0,50,150,300")
    parser.add_argument("--chromium", type=int, default=0)
    given = parser.parse_args()
    delays = [int(delay) for delay in given.delays.split(",")]
    print("| | delay, ms | predicted | hands' contacts | force, N | energy, mJ | % a tick | % a frame | apart, mm |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for delay in delays:
        for predicted in (True, False):
            print(in_virtual_time(delay, predicted, given.contacts), flush=True)
    if given.chromium:
        with launched(lambda chromium: draw_plainly(chromium, (PLAIN,))) as chromium:  # type: ignore[no-untyped-call]
            for delay in delays:
                for predicted in (True, False):
                    print(in_chromium(chromium, delay, predicted, given.chromium), flush=True)


if __name__ == "__main__":
    main()
