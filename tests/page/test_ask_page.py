"""The page that asks two alternatives, in a real Chromium: who reads the force, who guesses, breaks, a death."""

import os
import re
import signal

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from support.browser import LAPTOP, PATIENCE, PHONE
from support.example_organs import ellipsoid
from support.running_server import start, until
from support.touch_page import Touched

import palpate as pp
from palpate.meshes.tet_mesh import TetMesh
from palpate.server.forced_choice_run import ForcedChoiceRun
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import running_session
from palpate.simulation.answer_fit import threshold_text
from palpate.simulation.interval_tissue import stimulus
from palpate.simulation.pointer import Pointer

pytestmark = pytest.mark.browser

LEVELS = tuple(np.geomspace(0.002, 2.0, 31))
TURNED = {"width": PHONE["height"], "height": PHONE["width"]}
LOWER_BUTTON, RIGHT_BUTTON, LEFT_SHOULDER, RIGHT_SHOULDER, TRIGGER = 0, 1, 4, 5, 7
PAD = """navigator.getGamepads = () => [window.pad];
window.pad = {connected: true, mapping: "standard", axes: [0, 0, 0, 0],
              buttons: Array.from({length: 17}, () => ({pressed: false, value: 0}))};"""
JITTER = 4  # steps of the slider to either side


@pytest.fixture(scope="module")
def organ():
    mesh = ellipsoid(9)
    plain = TetMesh(mesh.nodes, mesh.tets, np.ones(len(mesh.tets), dtype=np.int32), {1: "organ"})
    return pp.Tissue(plain, 5.0, 0.45, pp.resting_on(plain, (0, 0, -1), depth=8.0))


class Participant(Touched):
    """Someone at the page. All that it does are pointer and key events."""

    def __init__(self, page, run=None):
        super().__init__(None, page)
        self.run = run

    def wait(self, expression, seconds=PATIENCE):
        """As ever, but it looks more often: a trial has seven waits."""
        for _ in range(40):
            if self.see(expression):
                return
            self.page.wait_for_timeout(10)
        super().wait(expression, seconds)

    def number(self):
        return self.page.locator("#trial-number").text_content()

    def until_asked(self):
        """Until a trial can be touched; ends a break."""
        self.wait("!document.getElementById('show-1').disabled || !document.getElementById('go-on').hidden")
        if self.page.locator("#go-on").is_visible():
            self.page.keyboard.press("Enter")
            self.wait("!document.getElementById('show-1').disabled")

    def take(self, interval):
        """Brings an interval under the hand."""
        if self.see("document.querySelector('#interval [aria-pressed=true]').dataset.value") != str(interval):
            self.page.keyboard.press("x")
            self.wait(f"document.getElementById('show-{interval}').getAttribute('aria-pressed') === 'true'")

    def press(self, interval, read=False):
        """Presses; the force that is shown once it stands still."""
        self.take(interval)
        self.page.mouse.move(*self.place())
        self.page.mouse.down()
        self.wait(f"document.getElementById('show-{interval}').textContent.endsWith('✓')")
        shown = self.stood_still() if read else None
        self.page.mouse.up()
        return shown

    def stood_still(self):
        """The force that is shown once it has settled: the loop fades into the exact stiffness."""
        self.settle(200)
        self.wait(
            "Math.hypot(...palpate.frame.force.slice(0, 3)).toFixed(2) === document.getElementById('force').textContent"
        )
        return float(self.page.locator("#force").text_content())

    def answer(self, interval):
        before = self.number()
        self.page.keyboard.press(str(interval))
        self.wait(f"document.getElementById('trial-number').textContent !== '{before}'")


@pytest.fixture
def asked(browser, organ, tmp_path):
    """Gives the page of an experiment."""
    closing = []

    def begin(viewport=LAPTOP, scheme="light", **changes):
        experiment = pp.ForcedChoice(**{"levels": LEVELS, "trials": 16, **changes})
        path, what = tmp_path / "answers.jsonl", stimulus(experiment, organ)
        pp.start_answers(path, pp.Answers(experiment, ""))
        base = pp.model(what.tissue(organ, 0.0), "compliance")
        run = ForcedChoiceRun(pp.read_answers(path), path, base, what)
        live = LiveSession(run.intervals[0], Pointer(), "organ", exam=run)
        serving = running_session(live, loopback_socket(None))
        context = browser.new_context(viewport=viewport, color_scheme=scheme)
        seen = Participant(context.new_page(), run)
        closing.extend([serving, context])
        seen.open(serving.__enter__())
        seen.path = path
        return seen

    yield begin
    serving, context = closing
    context.close()
    serving.__exit__(None, None, None)


def test_who_reads_the_force_comes_to_the_ideal_observers_threshold(asked, organ):
    seen, rng = asked(seed=61), np.random.default_rng(61)
    slider, at, depths, points = seen.page.locator("#amount"), 0, [], []

    def pressed(interval):
        nonlocal at
        to = int(rng.integers(-JITTER, JITTER + 1))
        slider.focus()
        for _ in range(abs(to - at)):
            seen.page.keyboard.press("ArrowRight" if to > at else "ArrowLeft")
        at = to
        depths.append(float(slider.input_value()) - to * float(slider.get_attribute("step")))
        force = seen.press(interval, read=True)
        return force

    while seen.number() != "Done":
        seen.until_asked()
        one, two = pressed(1), pressed(2)
        points.append(seen.see("palpate.frame.point.slice(0, 3)"))
        seen.answer(1 if one > two or (one == two and rng.random() < 0.5) else 2)
    answers = pp.read_answers(seen.path)
    assert len(answers.trials) == 16
    assert all(min(one.force) > 0.05 for one in answers.trials)
    found = pp.fit_answers(answers.trials, answers.experiment)
    width = (2 * JITTER + 1) * float(slider.get_attribute("step"))
    depth = float(np.median(depths))
    ideal = pp.ideal_observer(
        answers.experiment, organ, point=np.median(points, axis=0), depth=depth, length_step=width
    )
    assert found.bounded, found.text
    assert ideal.bounded
    assert found.interval[0] < ideal.function.threshold < found.interval[1], (found.text, ideal.text)
    assert found.interval[1] < 30 * found.interval[0], "an interval that says something"
    assert seen.problems == []


def test_who_guesses_gets_no_threshold(asked):
    seen, rng = asked(seed=3, trials=6, pause=0, feedback=True), np.random.default_rng(5)
    told = set()
    while seen.number() != "Done":
        seen.until_asked()
        for interval in (1, 2):
            seen.press(interval)
        seen.answer(int(rng.integers(1, 3)))
        last = pp.read_answers(seen.path).trials[-1]
        note = seen.page.locator("#trial-note").text_content()
        assert note.startswith("Right. " if last.right else "Wrong. ")
        told.add(last.right)
    assert told == {True, False}
    answers = pp.read_answers(seen.path)
    found = pp.fit_answers(answers.trials, answers.experiment)
    assert not found.bounded
    assert threshold_text(found).startswith("no threshold")
    assert seen.problems == []


@pytest.mark.parametrize(("viewport", "scheme"), [(LAPTOP, "light"), (PHONE, "dark"), (TURNED, "light")])
def test_the_page_of_a_question(asked, album, viewport, scheme):
    seen = asked(viewport, scheme, question="lump", diameter=16, trials=4, pause=1, seed=1)
    name = f"ask-{scheme}-{viewport['width']}"
    seen.until_asked()
    assert seen.page.locator("#question").text_content() == "Which holds the lump?"
    assert seen.number() == "Trial 1 of 4"
    assert seen.page.locator("#place").is_visible(), "it is marked where the lump may be"
    assert not seen.page.locator("#timing").is_visible()
    assert seen.page.locator("#answer-1").is_disabled()
    seen.page.keyboard.press("1")
    seen.page.wait_for_timeout(200)
    assert seen.number() == "Trial 1 of 4", "no answer without a touch"
    seen.press(1)
    assert seen.page.locator("#trial-note").text_content() == "Now touch interval 2."
    seen.page.screenshot(path=album / f"{name}-one.png")
    seen.page.click("#show-2")
    seen.wait("document.getElementById('show-2').getAttribute('aria-pressed') === 'true'")
    seen.press(2)
    assert seen.page.locator("#answer-2").is_enabled()
    assert Axe().run(seen.page).response["violations"] == []
    boxes = [seen.page.locator(f"#{one}").bounding_box() for one in ("show-1", "answer-1", "answer-2", "trial-note")]
    for box in boxes:
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= viewport["width"]
        assert box["y"] + box["height"] <= viewport["height"], "all of the question is seen without scrolling"
    seen.page.screenshot(path=album / f"{name}-both.png")
    seen.page.click("#answer-2")
    seen.wait("!document.getElementById('go-on').hidden")
    assert seen.page.locator("#trial-note").text_content() == "Time for a break. Go on when you like."
    assert seen.see("document.activeElement.id") == "go-on"
    assert not seen.page.locator("#answer-1").is_visible()
    seen.page.screenshot(path=album / f"{name}-break.png")
    seen.until_asked()
    assert seen.number() == "Trial 2 of 4"
    assert seen.problems == []


def test_a_gamepad_shows_and_answers(asked):
    seen = asked(channel="gamepad", trials=4, pause=1)
    seen.until_asked()
    seen.see(PAD)

    def push(button, value=1):
        seen.see(f"Object.assign(window.pad.buttons[{button}], {{ pressed: true, value: {value} }})")

    def let_go(button):
        seen.see(f"Object.assign(window.pad.buttons[{button}], {{ pressed: false, value: 0 }})")

    for interval, shoulder in ((1, LEFT_SHOULDER), (2, RIGHT_SHOULDER)):
        push(shoulder)
        seen.wait(f"document.getElementById('show-{interval}').getAttribute('aria-pressed') === 'true'")
        let_go(shoulder)
        push(TRIGGER, 0.8)
        seen.wait(f"document.getElementById('show-{interval}').textContent.endsWith('✓')")
        let_go(TRIGGER)
    assert seen.page.locator("#force").is_visible()
    push(RIGHT_BUTTON)
    seen.wait("!document.getElementById('go-on').hidden")
    push(LOWER_BUTTON)
    seen.wait("!document.getElementById('show-1').disabled")
    (one,) = pp.read_answers(seen.path).trials
    assert (one.answer, one.channel) == (2, "gamepad")
    assert seen.problems == []


def test_a_force_that_is_heard_is_not_read(asked):
    seen = asked(channel="sound")
    seen.until_asked()
    seen.press(1)
    mode = "document.querySelector('#sound [aria-pressed=true]').dataset.value"
    for hidden in ("#force", "#bar", "#plots", "#sound"):
        assert not seen.page.locator(hidden).is_visible(), hidden
    assert seen.see(mode) == "pitch"
    seen.page.keyboard.press("m")
    assert seen.see(mode) == "pitch", "no other channel can be chosen"
    assert seen.problems == []


def test_a_killed_experiment_goes_on_with_the_same_question(browser, organ, tmp_path, album):
    pp.write_tissue(tmp_path / "tissue.vtu", organ)
    words = "ask tissue.vtu -o answers.jsonl --trials 3 --seed 4 --levels 0.05,0.1,0.2,0.4,0.8 --no-browser"
    path, context = tmp_path / "answers.jsonl", browser.new_context(viewport=LAPTOP)

    def answered(run, count):
        line = ""
        while "http" not in line:
            line = run.stdout.readline()
            assert line, run.stderr.read()
        seen = Participant(context.new_page())
        seen.open(re.search(r"http\S+", line)[0])
        for _ in range(count):
            seen.until_asked()
            for interval in (1, 2):
                seen.press(interval)
            seen.answer(1)
        seen.until_asked()
        return seen

    first = start(words, tmp_path)
    seen = answered(first, 2)
    expected = pp.read_answers(path).next_level, pp.read_answers(path).experiment.orders[2]
    assert seen.number() == "Trial 3 of 3"
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    seen.page.close()
    second = start(f"{words} --resume", tmp_path)
    try:
        seen = answered(second, 0)
        assert seen.number() == "Trial 3 of 3"
        for interval in (1, 2):
            seen.press(interval)
        seen.answer(2)
        until(lambda: len(pp.read_answers(path).trials) == 3)
        third = pp.read_answers(path).trials[2]
        assert (third.level, third.order) == expected
        assert seen.number() == "Done"
        out, err = second.communicate(timeout=60)
        seen.page.screenshot(path=album / "ask-done.png")
    finally:
        second.kill()
        context.close()
    assert second.returncode == 0, err
    assert "stiffness by screen, 3 answers: no threshold" in out
    assert "ideal observer" in out
    table = (tmp_path / "answers.csv").read_text().splitlines()
    assert table[0].startswith("trial,question,level,order,answer,right,seconds,channel")
    assert len(table) == 4
    assert (tmp_path / "answers.svg").read_text().startswith("<?xml")
