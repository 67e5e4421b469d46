"""The panels in a real napari, with a screen that exists in memory alone: make test-neighbours."""

import time

import httpx
import numpy as np
import pytest

import palpate as pp

napari = pytest.importorskip("napari", reason="napari is not installed: make test-neighbours")


@pytest.fixture
def viewer():
    shown = napari.Viewer(show=False)
    yield shown
    shown.close()


@pytest.fixture
def told(monkeypatch):
    """What the panels show as an error."""
    said = []
    for panel in ("reconstruct_panel", "touch_panel"):
        module = __import__(f"palpate.napari_plugin.{panel}", fromlist=[panel])
        monkeypatch.setattr(module, "show_error", said.append)
    return said


def until(condition, seconds=120):
    """Lets Qt do its work until something is so."""
    from qtpy.QtWidgets import QApplication

    end = time.monotonic() + seconds
    while not condition():
        QApplication.processEvents()
        assert time.monotonic() < end, "it does not come"
        time.sleep(0.01)


@pytest.fixture
def scan(tmp_path):
    panel = pp.Panel((32, 40), (2.0, 2.0), (-39.0, -31.0, 0.0))
    views = pp.arc_views(panel, np.linspace(-15, 15, 7), radius=600, pivot=(0, 0, 15))
    grid = pp.covering_grid(views, 30, 2.0)
    centres = grid.points(np.stack(np.indices(grid.shape), axis=-1))
    ball = np.linalg.norm(centres - (0, 0, 15), axis=-1) < 12
    lines = pp.Projector(views, grid)(np.where(ball, 0.02, 0).astype(np.float32))
    path = tmp_path / "ball.h5"
    pp.write_scan(path, pp.Scan(np.random.default_rng(1).poisson(2e4 * np.exp(-lines)), 2e4, views))
    return path


def test_files_open_through_its_menus(viewer, scan, tmp_path):
    grid = pp.Grid((4, 5, 6), (3.0, 2.0, 1.0), (10, 20, 30))
    pp.write_labels(tmp_path / "organs.nii.gz", pp.Labels(np.arange(120).reshape(grid.shape) % 4, grid, {1: "liver"}))
    viewer.open(str(scan), plugin="palpate")
    viewer.open(str(tmp_path / "organs.nii.gz"), plugin="palpate")
    kinds = [type(layer).__name__ for layer in viewer.layers]
    assert kinds == ["Image", "Labels"]
    from palpate.napari_plugin.layers import grid_of

    assert grid_of(viewer.layers[1]) == grid
    viewer.open_sample("palpate", "breast")
    assert viewer.layers[-1].data.shape[0] == 7


def test_a_scan_is_reconstructed_in_one_layer(viewer, scan, told):
    dock, panel = viewer.window.add_plugin_dock_widget("palpate", "Reconstruct a scan")
    panel.scan.value = str(scan.parent / "missing.h5")
    panel.button.native.click()
    assert "no such file" in told[0]
    panel.scan.value, panel.thickness.value, panel.iterations.value = str(scan), 30.0, 10
    panel.button.native.click()
    assert panel.button.text == "Stop"
    until(lambda: panel.worker is None)
    (layer,) = viewer.layers
    expected = pp.reconstruct(pp.read_scan(scan), thickness=30.0, iterations=10)
    np.testing.assert_array_equal(layer.data, expected.values)
    from palpate.napari_plugin.layers import grid_of

    assert grid_of(layer) == expected.grid
    assert panel.button.text == "Reconstruct"
    assert len(told) == 1
    panel.iterations.value = 1000
    panel.thickness.value = 60.0
    panel.button.native.click()
    until(lambda: len(viewer.layers) == 2)
    panel.button.native.click()
    until(lambda: panel.worker is None)
    assert panel.button.text == "Reconstruct"
    viewer.window.remove_dock_widget(dock)


def test_a_drawn_label_becomes_an_organ_in_the_browser(viewer, told, monkeypatch, tmp_path):
    """The browser is one that notes the address; a page is fetched from there."""
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\necho "$1" > {tmp_path}/address\n')
    browser.chmod(0o755)
    monkeypatch.setenv("BROWSER", str(browser))
    z, y, x = np.indices((30, 34, 40)) - np.array([15, 17, 20]).reshape(3, 1, 1, 1)
    ball = ((2 * z) ** 2 + (2 * y) ** 2 + (2 * x) ** 2 < 25**2).astype(np.uint8)
    viewer.add_labels(3 * ball, name="drawn", scale=(2, 2, 2), translate=(100, 50, 0))
    _, panel = viewer.window.add_plugin_dock_widget("palpate", "Touch an organ")
    panel.button.native.click()
    assert "no voxel has the label 1" in told[0]
    panel.number.value, panel.edge.value = 3, 6.0
    panel.button.native.click()
    until(lambda: panel.simulator is not None)
    until(lambda: (tmp_path / "address").exists() and (tmp_path / "address").read_text().strip())
    page = httpx.get((tmp_path / "address").read_text().strip())
    assert page.status_code == 200
    surface = viewer.layers[-1]
    centre = surface.data[0].mean(axis=0)
    np.testing.assert_allclose(centre, (130, 84, 40), atol=1.5)
    panel.button.native.click()
    assert panel.simulator is None
    assert panel.button.text == "Touch"
    assert len(told) == 1
