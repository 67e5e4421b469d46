"""From the command to the first answered push: python -m benchmarks.first_touch [--edge 2.4] [--rounds 5].

The sample's kidney is meshed and written once. Then `palpate touch` is started as a user would, and a page's socket is
opened as soon as the address is printed; it presses 2 mm and waits for the first frame that answers with a force. It goes
on until the session has changed to the model that followed. Prints the medians, in seconds after the command.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from websockets.sync.client import ClientConnection, connect

import palpate as pp
from benchmarks.random_hands import decoded
from palpate.server import messages
from palpate.simulation.pointer import CommandKind
from palpate.tissue.models.registry import names_in_sessions
from palpate.tissue.spring_fitting import scattered_points, surface_normals

SERIAL, FORCE = 1, 1e-3  # N
LONGEST = 120.0  # s


def kidney(folder: Path, edge: float) -> Path:
    """A tissue of the sample's left kidney, written to a file."""
    labels = pp.read_labels(Path(pp.__file__).parent / "samples" / "abdomen" / "labels.nii.gz")
    mesh = pp.tetrahedralize(labels, "kidney_left", edge=edge)
    path = folder / "kidney.vtu"
    pp.write_tissue(path, pp.Tissue(mesh, 15.0, 0.45, pp.resting_on(mesh, (0, 1, 0))))
    return path


def frames(socket: ClientConnection) -> Iterator[dict[str, tuple[float, ...]]]:
    """Of the server, as they come."""
    while True:
        data = socket.recv(timeout=LONGEST)
        if isinstance(data, bytes) and data[0] == messages.BINARY.index(messages.Frame) + 1:
            yield decoded(data)


def first_touch(path: Path, tissue: pp.Tissue) -> dict[str, float]:
    """Seconds from the command to the address, to the first answer, and to the model that follows."""
    point = scattered_points(tissue, 1)[0]
    inwards = -2.0 * surface_normals(tissue, point[None])[0]
    seconds: dict[str, float] = {}
    with ExitStack() as closing:
        began = time.perf_counter()
        command = [sys.executable, "-m", "palpate", "touch", str(path), "--no-browser"]
        server = closing.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        closing.callback(server.terminate)
        assert server.stdout is not None
        address = next(word for line in server.stdout for word in line.split() if word.startswith("http"))
        seconds["address"] = time.perf_counter() - began
        base, token = address.split("/?")
        socket = closing.enter_context(
            connect(f"{base.replace('http', 'ws')}/socket?{token}", origin=base, max_queue=None)
        )
        press = messages.ToolCommand(0, CommandKind.hold, SERIAL, tuple(point), tuple(inwards))
        socket.send(messages.encode(press))
        for frame in frames(socket):
            if frame["serial"] == (SERIAL,) and np.linalg.norm(frame["force"][:3]) > FORCE:
                break
        seconds["first answer"] = time.perf_counter() - began
        first = int(frame["model"][0])
        for frame in frames(socket):
            if frame["model"] == frame["chosen"]:
                break
        seconds["last model"] = time.perf_counter() - began
        seconds["late ticks, %"] = 100 * frame["late"][0] / max(frame["tick"][0], 1)
        last = int(frame["model"][0])
        print(f"{names_in_sessions()[first]}, then {names_in_sessions()[last]}: {seconds}", flush=True)
    return seconds


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.first_touch", description=__doc__.splitlines()[0])
    parser.add_argument("--edge", type=float, default=2.4, help="mm, of the mesh")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = kidney(Path(folder), options.edge)
        tissue = pp.read_tissue(path)
        rounds = [first_touch(path, tissue) for _ in range(options.rounds)]
    print(f"`python -m benchmarks.first_touch --edge {options.edge:g}`: {len(tissue.mesh.nodes)} nodes")
    for name in rounds[0]:
        print(f"{name}: {np.median([one[name] for one in rounds]):.2f}")
