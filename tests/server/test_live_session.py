"""Choices of model and mesh while the session runs: the last one wins, whatever is being built."""

import contextlib
import threading
from collections import defaultdict

import pytest
from support.example_organs import organ
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

import palpate as pp
from palpate.errors import MaterialError
from palpate.server import live_session, messages
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import running_session
from palpate.simulation import starting_model
from palpate.simulation.pointer import Pointer
from palpate.tissue.models.registry import names_in_sessions

MODEL, ORGAN = 0, 1


@pytest.fixture
def released(monkeypatch):
    """Events by name: the server makes a model of that name only once its event is set. "begun NAME" says that it waits."""
    real, events = live_session.build, defaultdict(threading.Event)

    def build(tissue, name):
        events[f"begun {name}"].set()
        assert events[name].wait(30)
        return real(tissue, name)

    monkeypatch.setattr(live_session, "build", build)
    yield events
    for name in names_in_sessions():
        events[name].set()


@pytest.fixture
def live():
    tissue = organ(7)
    session = pp.Session(
        pp.model(tissue, "blocks"), radius=14.0, sweeps=2, tension=3.0, toughness={"lump": 90.0}, blade_friction=0.1
    )
    return LiveSession(session, Pointer(), organs={"coarse": tissue, "fine": organ(9)})


class Page:
    """A page's socket, opened again when the scene changes."""

    def __init__(self, address, closing):
        self.base, self.token = address.split("/?")
        self.closing, self.told, self.scenes = closing, [], 0
        self.open()

    def open(self):
        address = f"{self.base.replace('http', 'ws')}/socket?{self.token}"
        self.socket = self.closing.enter_context(connect(address, origin=self.base, max_queue=None))
        self.scenes += 1

    def choose(self, kind, name_or_index):
        index = names_in_sessions().index(name_or_index) if kind == MODEL else name_or_index
        self.socket.send(messages.encode(messages.Selection(kind, index)))

    def model(self):
        """Of the next frame."""
        while True:
            try:
                data = self.socket.recv(timeout=10)
            except ConnectionClosed:
                self.open()
                continue
            if isinstance(data, bytes):
                return names_in_sessions()[data[1]]
            self.told.append(data)

    def until(self, true):
        for _ in range(600):
            if true(self.model()):
                return
        pytest.fail("never came")


@contextlib.contextmanager
def page_of(live):
    with running_session(live, loopback_socket(None)) as address, contextlib.ExitStack() as closing:
        yield Page(address, closing)


def test_a_model_that_stands_in_hands_over_to_the_one_that_is_made_meanwhile(live, released, monkeypatch):
    """By itself; and the record has both."""
    monkeypatch.setattr(starting_model, "QUICK", 10)
    found = starting_model.starting_model(next(iter(live.organs.values())))
    assert found.successor == "compliance"
    session = pp.Session(found.model, radius=14.0)
    live = LiveSession(session, Pointer(), reason=found.reason, successor=found.successor)
    with page_of(live) as page:
        assert page.model() == "compliance-P1"
        assert released["begun compliance"].wait(10)
        assert page.model() == "compliance-P1"
        released["compliance"].set()
        page.until(lambda name: name == "compliance")
    record = session.record()
    assert (record.model, record.changes[0][1]) == ("compliance-P1", "compliance")
    again = pp.Session(pp.model(session.first.tissue, "compliance-P1"), radius=14.0, sweeps=session.settings.sweeps)
    assert again.replay(record) is None


def test_the_last_choice_wins_over_one_that_is_being_built(live, released):
    with page_of(live) as page:
        page.choose(MODEL, "compliance")
        assert released["begun compliance"].wait(10)
        page.choose(MODEL, "multigrid")
        page.choose(MODEL, "springs")
        released["compliance"].set()
        released["springs"].set()
        seen = set()
        page.until(lambda name: seen.add(name) or name == "springs")
        assert seen <= {"blocks", "springs"}
        assert {name for _, name in live.models} == {"compliance", "springs"}  # what nobody wants is not begun


def test_back_to_the_model_that_runs_while_another_is_built(live, released):
    with page_of(live) as page:
        page.choose(MODEL, "compliance")
        page.choose(MODEL, "blocks")
        page.choose(MODEL, "springs")
        page.choose(MODEL, "blocks")
        for event in (released["compliance"], released["blocks"], released["springs"]):
            event.set()
        assert {page.model() for _ in range(60)} == {"blocks"}


def test_a_mesh_chosen_while_a_model_is_built_brings_both(live, released):
    with page_of(live) as page:
        page.choose(MODEL, "springs")
        page.choose(ORGAN, 1)
        released["springs"].set()
        page.until(lambda name: live.session.first.tissue is live.organs["fine"] and name == "springs")
    after = live.session
    assert (after.tension, after.toughness, after.blade_friction) == (3.0, {"lump": 90.0}, 0.1), (
        "what was said of the organ"
    )


def test_a_model_that_cannot_be_made_is_said_and_the_next_choice_comes(live, released, monkeypatch, capsys):
    real = live_session.build

    def build(tissue, name):
        if name == "multigrid":
            raise MaterialError("no multigrid today")
        return real(tissue, name)

    monkeypatch.setattr(live_session, "build", build)
    released["springs"].set()
    with page_of(live) as page:
        page.choose(MODEL, "multigrid")
        for _ in range(100):
            page.model()
            if page.told:
                break
        assert page.told == ["multigrid was not made: no multigrid today"]
        assert "no multigrid today" in capsys.readouterr().out
        assert live.choice == live.current  # so the page shows what answers
        page.choose(ORGAN, 1)
        released["blocks"].set()
        # Frames of the old scene may still be queued; what is chosen on a socket that is closing is lost.
        page.until(lambda name: page.scenes == 2 and name == "blocks")
        assert live.session.first.tissue is live.organs["fine"]
        page.choose(MODEL, "springs")
        page.until(lambda name: name == "springs")
