"""How many frames are under way to a page, on ways of a given length and width, by a clock of the test's own."""

from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.server import frame_flow
from palpate.server.frame_flow import FrameFlow

TICK = 0.001  # s of the test's clock
INTERVAL, TELL = 0.016, 0.1  # s between frames that the server has, and between two words of a page


@pytest.fixture
def travel(monkeypatch):
    """Frames that come over a way for so many seconds: when each came, and how old it was then, s.

    length(t): s there, and s back, at a time. width(t): frames a second that it carries.
    """

    def run(seconds, length, width):
        now = 0.0
        monkeypatch.setattr(frame_flow, "time", SimpleNamespace(monotonic=lambda: now))
        flow, queue, coming, words = FrameFlow(), deque(), deque(), deque()
        came, ages = [], []
        free = told = 0.0
        for k in range(round(seconds / TICK)):
            now = k * TICK
            while words and words[0][0] <= now:
                flow.taken(words.popleft()[1])
            if k % round(INTERVAL / TICK) == 0 and not flow.behind:
                flow.send()
                queue.append(now)
            while queue and free <= now:
                free = max(free, now) + 1 / width(now)
                coming.append((free + length(now), queue.popleft()))
            while coming and coming[0][0] <= now:
                came.append(now)
                ages.append(now - coming.popleft()[1])
            if now >= told + TELL:
                told = now
                words.append((now + length(now), len(came)))
        return np.array(came), np.array(ages)

    return run


@pytest.mark.parametrize("length", [0.001, 0.05, 0.15, 0.3])
def test_a_way_that_carries_all_frames_gets_them_all(travel, length):
    came, ages = travel(40, lambda t: length, lambda t: 200)
    assert len(came) > 0.96 * (40 - length) / INTERVAL
    assert np.diff(came).max() < 2 * length + 0.3
    assert ages.max() < length + 0.02


@pytest.mark.parametrize("length", [0.001, 0.05, 0.15, 0.3])
@pytest.mark.parametrize("width", [5, 15, 40])
def test_a_narrow_way_is_full_and_its_frames_are_young(travel, length, width):
    """Once those have come that were sent before the page's first word."""
    came, ages = travel(40, lambda t: length, lambda t: width)
    settled = came > 12
    assert np.count_nonzero(settled) > 0.85 * 28 * width
    assert np.median(ages[settled]) < 2 * length + 0.3 + 2.5 / width
    assert np.quantile(ages[settled], 0.99) < 2 * length + 0.4 + 3.5 / width


def test_a_way_that_becomes_longer_is_full_again_after_some_seconds(travel):
    """From a cable to a telephone."""
    came, _ = travel(60, lambda t: 0.005 if t < 20 else 0.3, lambda t: 200)
    assert np.count_nonzero(came > 45) > 0.95 * 15 / INTERVAL


def test_a_way_that_becomes_wider_carries_more_at_once(travel):
    came, ages = travel(40, lambda t: 0.02, lambda t: 5 if t < 20 else 200)
    assert np.count_nonzero(came > 22) > 0.97 * 18 / INTERVAL
    assert ages[came > 22].max() < 0.06


def test_a_page_that_says_nothing_gets_all():
    flow = FrameFlow()
    for _ in range(5000):
        assert not flow.behind
        flow.send()
