"""ParaView reads a tissue and what a push does to it: make test-neighbours, with Debian's python3-paraview."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import meshio
import numpy as np
import pytest
from PIL import Image
from support.example_organs import organ

import palpate as pp

pytestmark = pytest.mark.skipif(
    not os.environ.get("PALPATE_NEIGHBOURS") or shutil.which("pvpython") is None or shutil.which("xvfb-run") is None,
    reason="make test-neighbours runs it, with Debian's python3-paraview and xvfb",
)


def test_paraview_finds_what_was_written(tmp_path):
    tissue = organ(7)
    mesh = tissue.mesh
    pp.write_tissue(tmp_path / "tissue.vtu", tissue)
    top = mesh.nodes[mesh.nodes[:, 2].argmax()]
    answer = pp.model(tissue, "compliance").push(top, (0, 0, -5), radii=10)
    pressed = meshio.Mesh(mesh.nodes, [("tetra", mesh.tets)], point_data={"displacement": answer.displacement})
    meshio.write(tmp_path / "pressed.vtu", pressed)
    script = Path(__file__).with_name("paraview_check.py")
    words = [
        "xvfb-run",
        "-a",
        "-w",
        "5",
        "pvpython",
        script,
        *(tmp_path / n for n in ("tissue.vtu", "pressed.vtu", "a.png")),
    ]
    alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    run = subprocess.run(list(map(str, words)), capture_output=True, text=True, timeout=300, env=alone)
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout.splitlines()[-1])
    assert found["tissue"]["count"] == {"points": len(mesh.nodes), "cells": len(mesh.tets)}
    assert found["tissue"]["cells"]["young"] == [5.0, 50.0]
    assert found["tissue"]["points"]["fixed"] == [0, 1]
    limits = np.stack([mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)], axis=1).ravel()
    np.testing.assert_allclose(found["tissue"]["bounds"], limits, atol=1e-6)
    assert found["volume"] == pytest.approx(mesh.volumes.sum(), rel=1e-6)
    np.testing.assert_allclose(found["size"], [0, np.linalg.norm(answer.displacement, axis=1).max()], atol=1e-6)
    moved = mesh.nodes + answer.displacement
    np.testing.assert_allclose(
        found["warped"], np.stack([moved.min(axis=0), moved.max(axis=0)], axis=1).ravel(), atol=1e-4
    )
    picture = np.asarray(Image.open(tmp_path / "a.png").convert("RGB"))
    assert np.ptp(picture.reshape(-1, 3), axis=0).min() > 50, "something is drawn"
