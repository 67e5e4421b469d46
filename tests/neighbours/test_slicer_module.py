"""The module of 3D Slicer, with stand-ins for what 3D Slicer gives it: the commands that it runs are palpate's own."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

import palpate as pp

MODULE = Path(__file__).parents[2] / "integrations" / "slicer" / "Palpate" / "Palpate.py"


@pytest.fixture
def slicer(monkeypatch, tmp_path):
    """3D Slicer, as far as the module asks for it: a segment is a ball, and processes are real."""
    grid = pp.Grid((30, 30, 30), (2.0, 2.0, 2.0), (10.0, 20.0, 30.0))
    away = np.linalg.norm(np.stack(np.indices(grid.shape), axis=-1) * 2.0 - 30.0, axis=-1)

    def save(node, path):
        pp.write_labels(path, pp.Labels((away < 22).astype(int), grid))
        return True

    def log(process):
        out, err = process.communicate(timeout=300)
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, process.args, out, err)

    def launch(words, useStartupEnvironment):
        assert not useStartupEnvironment
        words = [sys.executable, *words[1:], *(["--no-browser"] if "touch" in words else [])]
        return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    python = tmp_path / "PythonSlicer"
    python.write_text("#!/bin/sh\n")
    python.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    bases = {name: type(name, (), {"__init__": lambda self, *_: None, "setup": lambda self: None}) for name in (
        "ScriptedLoadableModule", "ScriptedLoadableModuleLogic", "ScriptedLoadableModuleWidget")}  # fmt: skip
    fake = MagicMock()
    fake.util = SimpleNamespace(
        saveNode=save, logProcessOutput=log, launchConsoleProcess=launch, pip_install=MagicMock()
    )
    for name, module in (("slicer", fake), ("vtk", MagicMock()), ("qt", MagicMock()),
                         ("slicer.ScriptedLoadableModule", SimpleNamespace(**bases))):  # fmt: skip
        monkeypatch.setitem(sys.modules, name, module)
    return fake


@pytest.fixture
def module(slicer):
    spec = importlib.util.spec_from_file_location("Palpate", MODULE)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


def test_a_segment_becomes_a_tissue_and_the_simulator_opens_it(module, slicer):
    logic = module.PalpateLogic()
    path = logic.touch("segmentation", "ball", 6.0, 5.0, 0.45, module.WAYS["its back"])
    tissue = pp.read_tissue(path)
    volume = 4 / 3 * np.pi * 22**3
    assert tissue.mesh.volumes.sum() == pytest.approx(volume, rel=0.05)
    np.testing.assert_allclose(tissue.mesh.nodes.mean(axis=0), (40, 50, 60), atol=1.0)
    assert (tissue.young == 5.0).all()
    assert tissue.mesh.nodes[tissue.fixed][:, 1].min() > 60, "it lies on its back"
    for line in logic.simulator.stdout:
        if "Ctrl-C" in line:
            break
    simulator = logic.simulator
    logic.closeSimulator()
    assert simulator.returncode is not None
    slicer.mrmlScene.RemoveNode.assert_called_once()
    slicer.util.pip_install.assert_not_called()


def test_a_command_that_fails_says_why(module):
    with pytest.raises(subprocess.CalledProcessError) as failed:
        module.PalpateLogic().touch("segmentation", "ball", 6.0, -5.0, 0.45, "0,1,0")
    assert "young" in failed.value.stderr.lower()


def test_its_panel_is_set_up_and_says_what_is_missing(module, slicer):
    panel = module.PalpateWidget()
    panel.layout = MagicMock()
    panel.setup()
    assert slicer.qMRMLSegmentSelectorWidget.called
    slicer.util.tryWithErrorDisplay = MagicMock()
    slicer.util.tryWithErrorDisplay.return_value.__exit__.return_value = False
    panel.segment.currentNode.return_value = None
    with pytest.raises(ValueError, match="Segment Editor"):
        panel.onTouch()
    panel.cleanup()
