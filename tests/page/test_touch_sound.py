"""What can be heard of the touch page: rendered by its own synthesizer in a real Chromium, and live."""

import numpy as np
import pytest
from scipy.signal import welch
from support.browser import LAPTOP
from support.example_organs import organ
from support.touch_page import Touched

import palpate as pp
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import serving

pytestmark = pytest.mark.browser
RATE = 44100  # Hz
RUMBLES = """(() => {
    window.rumbles = [];
    const playEffect = (kind, how) => (window.rumbles.push([kind, how.duration]), Promise.resolve("complete"));
    const pad = { connected: true, mapping: "standard", axes: [0, 0, 0, 0], buttons: [], vibrationActuator: { playEffect } };
    navigator.getGamepads = () => [pad];
})()"""


@pytest.fixture(scope="module")
def touched(browser):
    session = pp.Session(pp.model(organ(9), "blocks"), radius=10.0, sweeps=2)
    context = browser.new_context(viewport=LAPTOP)
    with serving(session, loopback_socket(None), title="Test organ") as address:
        mine = Touched(session, context.new_page())
        mine.page.add_init_script(RUMBLES)
        mine.open(address)
        yield mine
        assert mine.problems == []
        context.close()


def rendered(touched, seconds, events=(), forces=(), limit=4.0):
    """(samples,) of what the page plays."""
    how = [seconds, [list(e) for e in events], [list(f) for f in forces], limit]
    samples = touched.page.evaluate("(how) => palpate.renderSound(...how)", how)
    assert len(samples) == round(seconds * RATE)
    return np.array(samples)


def onset(samples):
    """s, where a tenth of the largest sample is first reached."""
    size = np.abs(samples)
    assert size.max() > 0.01
    return np.argmax(size > 0.1 * size.max()) / RATE


@pytest.mark.parametrize("event", ["contact", "release", "pierced", "cut", "limit"])
def test_a_sound_begins_within_20_ms_of_its_event_and_ends(touched, event):
    samples = rendered(touched, 1.2, [(event, 0.25)])
    assert np.abs(samples[: int(0.25 * RATE)]).max() == 0
    assert 0.25 <= onset(samples) < 0.27
    assert np.abs(samples[RATE:]).max() < 1e-3
    assert np.abs(samples).max() <= 1  # nothing is clipped


def test_events_sound_different(touched):
    """Centres of gravity of their spectra, Hz: taps are dull, piercing is bright."""
    centre = {}
    for event in ("contact", "release", "pierced", "cut", "limit"):
        frequency, power = welch(rendered(touched, 0.4, [(event, 0.0)]), RATE, nperseg=4096)
        centre[event] = (frequency * power).sum() / power.sum()
    assert centre["release"] < centre["contact"] < centre["limit"] < centre["cut"] < centre["pierced"]


def test_pitch_rises_with_the_force_by_two_octaves_up_to_the_limit(touched):
    forces = [0.0, 0.05, 0.5, 1.0, 2.0, 3.0, 4.0, 4.5]
    heard = []
    for force in forces[1:]:
        samples = rendered(touched, 0.6, forces=[(force, 0.0)])[int(0.2 * RATE) :]
        spectrum = np.abs(np.fft.rfft(samples * np.hanning(len(samples)), 1 << 18))
        heard.append(np.argmax(spectrum) * RATE / (1 << 18))
    assert (np.diff(heard) > 0).all()
    np.testing.assert_allclose(heard, [220 * 2 ** (2 * force / 4.0) for force in forces[1:]], rtol=5e-3)
    assert np.abs(rendered(touched, 0.3, forces=[(0.0, 0.0)])).max() == 0  # no force, no tone
    loud = rendered(touched, 0.8, forces=[(2.0, 0.0), (0.0, 0.4)])
    assert np.abs(loud[int(0.5 * RATE) :]).max() < 1e-4  # and none after it
    assert onset(rendered(touched, 0.3, forces=[(2.0, 0.1)])) < 0.12


def test_touching_is_heard_and_felt_and_a_key_turns_it_off(touched):
    page = touched.page
    touched.drag(touched.place(), np.array((20, 10)))
    touched.wait("palpate.played.some((sound) => sound.event === 'contact')")
    contact = touched.see("palpate.played.find((sound) => sound.event === 'contact')")
    assert contact["begins"] - contact["now"] < 200  # what the machine's own sound output adds
    assert touched.see("rumbles.some(([kind, duration]) => kind === 'dual-rumble' && duration === 40)")
    page.mouse.up()
    touched.wait("palpate.played.some((sound) => sound.event === 'release')")
    touched.until_home()
    before = touched.see("palpate.played.length")
    page.keyboard.press("m")
    page.keyboard.press("m")
    assert page.locator("#sound [aria-pressed=true]").text_content() == "Off"
    felt = touched.see("rumbles.length")
    touched.drag(touched.place(), np.array((20, 10)))
    touched.wait("palpate.frame.contact[0] === 1")
    page.mouse.up()
    touched.until_home()
    assert touched.see("palpate.played.length") == before
    assert touched.see("rumbles.length") == felt
    page.click("#sound >> text=Events")
    page.click("#tool >> text=Needle")
    page.mouse.click(*touched.place())
    touched.see("document.getElementById('amount').focus()")
    for _ in range(12):
        page.keyboard.press("+")
    touched.wait("palpate.played.some((sound) => sound.event === 'pierced')")
    page.keyboard.press("o")
