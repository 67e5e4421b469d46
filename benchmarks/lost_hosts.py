"""How long a room is away when its process is killed, or its host with its disk, and whether its state comes back whole.

    python -m benchmarks.lost_hosts [--times 20] [--what process,redis,nats]

Each time somebody makes a cut and a note, and a second later the room's process is killed (its host's memory keeps them), or
the host: its server, its rooms and its folder (a real Redis or NATS keeps them). A client comes back as a page does, with a
try each 0.3 s, by way of a host that is left. The time is that from the death to its first frame; what it finds is compared
with what was there. Exit code 1 if anything is lost.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.example_organs import organ
from support.open_rooms import open_rooms
from support.registries import registry_server
from support.several_hosts import TOP, ServingHost, back, cut_over_the_top, page_of, scene_of

import palpate as pp
from palpate.server import messages

SETTLED = 1.0  # s between the note and the death


def operate(host, token, note):
    """Makes a cut and a note, and returns the triangles of the organ then."""
    before = scene_of(host, token)["triangles"]
    with page_of(host, token) as page:
        cut_over_the_top(page, 6.0 * (len(note) % 2))
        while scene_of(host, token)["triangles"] == before:
            time.sleep(0.05)
        page.send(messages.encode(messages.Note(0, 0, TOP)) + note.encode())
        time.sleep(SETTLED)
        return scene_of(host, token)["triangles"]


def process_deaths(times, folder):
    """Times and whether all came back, of a room whose process is killed."""
    pp.write_tissue(folder / "kidney.vtu", organ(9))
    for number in range(times):
        (place := folder / str(number)).mkdir()
        with open_rooms([pp.RoomFile("kidney", (folder / "kidney.vtu",))], place) as opened:
            token = opened.address("kidney", "teacher").split("token=")[1]
            triangles = operate(opened, token, f"note {number}")
            opened.rooms["kidney"]._process.kill()
            scene, notes, took = back(opened, token)
            yield took, scene["triangles"] == triangles and notes == [f"note {number}"]


def host_deaths(kind, times, folder):
    """The same of hosts that are lost: each time another one comes, and the one that has the room is lost."""
    pp.write_tissue(folder / "kidney.vtu", organ(9))
    for number in range(times):
        place = folder / str(number)
        (place / "registry").mkdir(parents=True)
        with registry_server(kind, place / "registry") as server:
            first, second = (ServingHost(place / name, folder / "kidney.vtu", server.address) for name in ("a", "b"))
            try:
                token = first.tokens["teacher"]
                triangles = operate(second, token, f"note {number}")
                first.lose()
                scene, notes, took = back(second, token)
                yield took, scene["triangles"] == triangles and notes == [f"note {number}"]
            finally:
                first.end()
                second.end()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--what", default="process,redis,nats")
    given = parser.parse_args()
    whole = True
    print("killed     times   whole   back after, s: median   largest")
    for what in given.what.split(","):
        with tempfile.TemporaryDirectory() as folder:
            deaths = process_deaths if what == "process" else lambda *rest, what=what: host_deaths(what, *rest)
            took, all_there = np.transpose(list(deaths(given.times, Path(folder))))
        name = what if what == "process" else f"host, {what}"
        print(f"{name:<13s}{len(took):3d}{int(sum(all_there)):8d}{np.median(took):24.2f}{max(took):10.2f}", flush=True)
        whole = whole and bool(all(all_there))
    sys.exit(not whole)


if __name__ == "__main__":
    main()
