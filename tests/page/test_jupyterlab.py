"""The widgets in a real JupyterLab, driven by a real browser: `make test-notebook` installs it."""

import ast
import json
import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from support.browser import LAPTOP
from support.touch_page import Touched

pytest.importorskip("jupyterlab", reason="JupyterLab is not installed here: make test-notebook")

TOUCHES = 5
CELLS = (
    """
import numpy as np
import palpate as pp
from support.example_organs import organ
tissue = organ(9)
z, y, x = np.indices((8, 10, 12))
volume = pp.Volume(100.0 * z + 10 * y + x, pp.Grid((8, 10, 12), (2, 1.5, 1), (0, 0, 0)), unit="HU")
pressed = []
def keep(change):
    pressed.append((w.force, w.point, w.displacement))
""",
    "w = pp.touch(tissue, title='Kidney')\nw.observe(keep, 'force')\nw",
    *["pp.touch(tissue, title='another')"] * (TOUCHES - 1),
    "v = pp.view(volume)\nv",
    """
force, point, displacement = next(each for each in reversed(pressed) if each[1] is not None)
expected = pp.model(tissue, "compliance").push(point, displacement, w.radius, tolerance=1e-6).force
off = float(np.linalg.norm(force - expected) / np.linalg.norm(expected))
print("told", [off, float(np.linalg.norm(force)), w.picked.region, w.session.length, pp.score(w.session, tissue).touches])
""",
    "w.tool = 'pull'; w.depth = 3.5; w.color = 'strain'; v.position = (4.2, 4.5, 2.0)\nprint('told', ['set'])",
    "print('told', [w.tool, w.depth, w.color, v.value])",
    "w.close()\nprint('told', ['closed'])",
)
CHECK, SET, READ, CLOSE = range(len(CELLS) - 4, len(CELLS))
TOKEN = "of-the-tests"


class Laboratory(Touched):
    """JupyterLab with the notebook of the tests; `frame` is the page in the first widget."""

    def __init__(self, page, address):
        super().__init__(None, page)
        self.address, self.frame = address, None

    def see(self, expression):
        return self.frame.evaluate(expression)

    def place(self, across=0.5, down=0.42):
        box = self.frame.locator("#view").bounding_box()
        return np.array([box["x"] + across * box["width"], box["y"] + down * box["height"]])

    def open(self, name="organ.ipynb"):
        self.page.goto(f"{self.address}/lab/tree/{name}?token={TOKEN}&reset")
        self.page.wait_for_selector(".jp-Notebook .jp-CodeCell", timeout=90_000)
        self.page.wait_for_selector(".jp-Notebook-ExecutionIndicator[data-status=idle]", timeout=90_000)

    def run(self, cell):
        """Runs a cell and returns what it says it told."""
        mine = self.page.locator(".jp-CodeCell").nth(cell)
        mine.locator(".cm-content").scroll_into_view_if_needed()
        mine.locator(".cm-content").click()
        self.page.keyboard.press("Control+Enter")
        said = mine.locator(".jp-OutputArea-output", has_text="told")
        said.wait_for(timeout=90_000)
        return ast.literal_eval(said.inner_text().removeprefix("told").strip())

    def wait_for_frames(self, count):
        """Until so many organs can be touched: a browser draws none that is out of sight."""
        for i in range(count):
            holder = self.page.locator(".palpate-widget iframe").nth(i)
            holder.wait_for(timeout=90_000)
            holder.scroll_into_view_if_needed()
            for _ in range(900):
                frame = holder.element_handle().content_frame()
                if frame and frame.evaluate("Boolean(window.palpate?.frame || window.viewer?.ready)"):
                    break
                self.page.wait_for_timeout(100)
            else:
                raise AssertionError(f"widget {i} does not begin")


@pytest.fixture(scope="module")
def jupyterlab(tmp_path_factory):
    """The address of a JupyterLab of its own, with the notebook in its folder."""
    home = tmp_path_factory.mktemp("jupyter")
    (home / "notebooks").mkdir()
    cells = [
        {"cell_type": "code", "id": f"c{i}", "execution_count": None, "metadata": {}, "outputs": [], "source": source.strip()}
        for i, source in enumerate(CELLS)
    ]  # fmt: skip
    kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    notebook = {"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}
    (home / "notebooks" / "organ.ipynb").write_text(json.dumps(notebook))
    settings = home / "CONFIG/lab/user-settings/@jupyterlab/apputils-extension/notification.jupyterlab-settings"
    settings.parent.mkdir(parents=True)
    settings.write_text('{"fetchNews": "false", "checkForUpdates": false}')  # nothing asks for anything outside
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    own = {f"JUPYTER_{name}_DIR": str(home / name) for name in ("CONFIG", "DATA", "RUNTIME")}
    path = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    server = subprocess.Popen(
        [sys.executable, "-m", "jupyterlab", "--no-browser", "--port", str(port), "--allow-root",
         f"--IdentityProvider.token={TOKEN}", f"--ServerApp.root_dir={home / 'notebooks'}"],
        env=os.environ | own | {"IPYTHONDIR": str(home / "ipython"), "PYTHONPATH": path},
        stdout=(home / "log").open("w"), stderr=subprocess.STDOUT,
    )  # fmt: skip
    address = f"http://127.0.0.1:{port}"
    for _ in range(600):
        try:
            urllib.request.urlopen(f"{address}/api?token={TOKEN}")
            break
        except (urllib.error.URLError, ConnectionError):
            assert server.poll() is None, (home / "log").read_text()
            time.sleep(0.1)
    yield address
    server.terminate()
    server.wait()


def test_widgets_in_jupyterlab(jupyterlab, browser, album):
    context = browser.new_context(viewport=LAPTOP | {"height": 1000})
    lab = Laboratory(context.new_page(), jupyterlab)
    lab.open()
    lab.page.click("text=Run >> nth=0")
    lab.page.click(
        '.lm-Menu-itemLabel:text("Run All Cells")'
    )  # those at the end find no touch yet: they run again below
    lab.wait_for_frames(TOUCHES + 1)
    first = lab.page.locator(".palpate-widget iframe").nth(0)
    first.scroll_into_view_if_needed()
    lab.frame = first.element_handle().content_frame()

    lab.drag(lab.place(), np.array((40, 10)))
    lab.settle()
    lab.page.screenshot(path=album / "jupyterlab.png")
    lab.page.mouse.up()
    lab.wait("palpate.frame.contact.every((state) => state === 0)")
    lab.page.wait_for_timeout(1000)  # the record is told a moment after letting go
    off, force, region, length, touches = lab.run(CHECK)
    assert off <= 1e-3
    assert force > 0.1
    assert region == "organ"
    assert length > 100
    assert touches == 1

    assert lab.run(SET) == ["set"]
    lab.wait("document.querySelector('#tool [aria-pressed=true]').dataset.value === 'pull'")
    lab.wait("document.getElementById('amount-set').textContent === '3.5 mm'")
    lab.page.wait_for_timeout(1000)  # for the viewer's answer
    tool, depth, color, value = lab.run(READ)
    assert (tool, color, value) == ("pull", "strain", 134)
    assert abs(depth - 3.5) < 0.1

    assert lab.run(CLOSE) == ["closed"]
    lab.page.wait_for_function(f"document.querySelectorAll('.palpate-widget iframe').length === {TOUCHES}")
    lab.page.keyboard.press("Control+s")
    lab.page.wait_for_timeout(2000)
    lab.page.close()
    end_kernels(jupyterlab)

    again = Laboratory(context.new_page(), jupyterlab)
    again.open()  # begins a kernel that knows of no widget
    pictures = again.page.locator(".jp-OutputArea-output .palpate-picture")
    again.page.wait_for_timeout(3000)
    assert pictures.count() == TOUCHES + 1
    for i in range(pictures.count()):
        assert pictures.nth(i).is_visible()
    shown = again.page.locator(".jp-OutputArea-output:visible").all_inner_texts()
    assert not [text for text in shown if "Error" in text and "widget" in text.lower()]
    again.page.screenshot(path=album / "jupyterlab-without-kernel.png")
    context.close()


def end_kernels(address):
    """Ends all kernels of a JupyterLab."""
    known = {"Authorization": f"token {TOKEN}"}
    kernels = json.load(urllib.request.urlopen(urllib.request.Request(f"{address}/api/kernels", headers=known)))
    for kernel in kernels:
        urllib.request.urlopen(
            urllib.request.Request(f"{address}/api/kernels/{kernel['id']}", method="DELETE", headers=known)
        )
