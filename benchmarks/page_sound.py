"""What the touch page sounds like: python -m benchmarks.page_sound [-o docs/images/touch.wav].

A real Chromium renders the page's own sounds offline: a finger touches, presses up to the limit of the force and lets go,
then a needle pierces. Prints when each event can be heard, and the pitch by force. Writes the sound to a file if asked.
"""

import argparse
import shutil
import wave
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.atomic_write import replacing
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import serving
from palpate.studies.deformation.kidney import kidney

RATE, SECONDS, LIMIT = 44100, 4.0, 4.0  # Hz, s, N
EVENTS = [("contact", 0.3), ("limit", 1.7), ("release", 2.6), ("pierced", 3.3)]
PRESS = [(LIMIT * 1.05 * s, 0.3 + 1.4 * s) for s in np.linspace(0, 1, 140)]  # N, s
FORCES = [*PRESS, (4.2, 2.0), (0.0, 2.6)]


def onset(samples: np.ndarray) -> float:
    """s, where a tenth of the largest sample is first reached."""
    size = np.abs(samples)
    return float(np.argmax(size > 0.1 * size.max()) / RATE)


def main(output: Path | None) -> None:
    """Prints the tables and writes the file."""
    from playwright.sync_api import sync_playwright

    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        raise SystemExit("no Chromium on the PATH: apt-get install chromium")
    with sync_playwright() as playwright:
        session = pp.Session(pp.model(kidney(10.0), "springs"))
        chromium = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        with serving(session, loopback_socket(None)) as address:
            page = chromium.new_page()
            page.goto(address)
            while not page.evaluate("Boolean(window.palpate && palpate.frame)"):
                page.wait_for_timeout(50)

            def heard(seconds: float, events: list[tuple[str, float]], forces: list[tuple[float, float]]) -> np.ndarray:
                how = [seconds, [list(e) for e in events], [list(map(float, f)) for f in forces], LIMIT]
                return np.array(page.evaluate("(how) => palpate.renderSound(...how)", how))

            print("| event | heard after, ms |\n|---|---|")
            for name, _ in EVENTS:
                print(f"| {name} | {1e3 * (onset(heard(0.5, [(name, 0.1)], [])) - 0.1):.1f} |")
            print("\n| force, N | pitch, Hz |\n|---|---|")
            for force in (0.5, 1.0, 2.0, 3.0, 4.0):
                samples = heard(0.6, [], [(force, 0.0)])[int(0.2 * RATE) :]
                spectrum = np.abs(np.fft.rfft(samples * np.hanning(len(samples)), 1 << 18))
                print(f"| {force:g} | {np.argmax(spectrum) * RATE / (1 << 18):.0f} |")
            if output is not None:
                write(output, heard(SECONDS, EVENTS, FORCES))
        chromium.close()


def write(path: Path, samples: np.ndarray) -> None:
    """Half the samples, 16 bits each."""
    pairs = samples[: len(samples) // 2 * 2].reshape(-1, 2).mean(axis=1)
    with replacing(path) as temporary, wave.open(str(temporary), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE // 2)
        file.writeframes((np.clip(pairs, -1, 1) * 32767).astype("<i2").tobytes())
    print(f"wrote {path}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.page_sound", description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, help="the sound, .wav")
    main(parser.parse_args().output)
