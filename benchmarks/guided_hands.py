"""What a guiding hand and a guided one get from the coupling between them, by the time that the network takes.

    python -m benchmarks.guided_hands [--contacts 40] [--delays 0,50,150,300]

Both hands are masses on springs, in virtual time (tests/support/guided_hands.mjs): each has its end of the coupling as the
pages have it. The network delays each way by so many ms with 20 % jitter; one message in twenty is held for 200 ms or 1.5
round trips, and all behind it. In half of the contacts the hands pull against each other to and fro, in half they move at
random; then a loose hand is led along at 10 mm/s for 4 s.

Told are, of the worst contact: the energy that both hands got together, at any time, with the tanks and without (mJ); of the
worst hand what it got, less what the other one had put in, at the end (mJ); the largest change of a force in a tick (N); and
how far the loose hand came, of the way of the one that led it (%).
"""

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.guided_hands import a_hand, at_random, guided_hands, pulling

SPEED, LENGTH = 10.0, 4000  # mm/s, ms


def row(delay: int, contacts: int, folder: Path) -> str:
    """Of the table."""
    rng = np.random.default_rng(1000 + delay)
    hands = [(pulling if i % 2 else at_random)(rng) for i in range(contacts)]  # type: ignore[no-untyped-call]
    told, without = (guided_hands(folder, hands, delay=delay, first=first) for first in (None, 1e9))  # type: ignore[no-untyped-call]
    beyond = max(beyond_other(contact) for contact in told)
    step = max(hand["step"] for contact in told for hand in contact["hands"])
    loose = a_hand([0.0] * 3, [1.0, 0, 0], 0, stiffness=0.0)  # type: ignore[no-untyped-call]
    leads = a_hand([0.0] * 3, [1.0, 0, 0], SPEED)  # type: ignore[no-untyped-call]
    (contact,) = guided_hands(folder, [[leads, loose]], delay=delay, way="on", length=LENGTH)  # type: ignore[no-untyped-call]
    one, other = (hand["last"]["x"][0] for hand in contact["hands"])
    together, alone = (max(contact["together"] for contact in each) for each in (told, without))
    return f"| {delay} | {together:.2f} | {alone:.0f} | {beyond:.2f} | {step:.3f} | {100 * other / one:.0f} |"


def beyond_other(contact: dict[str, Any]) -> float:
    """N mm that a hand got, less what the other one put in."""
    one, other = (hand["energy"] for hand in contact["hands"])
    return max(float(one + min(0, other)), float(other + min(0, one)))


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--contacts", type=int, default=40)
    parser.add_argument("--delays", default="0,50,150,300")
    given = parser.parse_args()
    print("| delay, ms | both, mJ | without tanks | a hand beyond the other | N a tick | led, % |")
    print("| --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        for delay in map(int, given.delays.split(",")):
            print(row(delay, given.contacts, Path(folder)), flush=True)


if __name__ == "__main__":
    main()
