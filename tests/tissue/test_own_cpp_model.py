"""The door to a tissue model in C++: examples/own_cpp_model is built against the installed headers, as a user would."""

import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import palpate as pp

SOURCE = Path(__file__).parents[2] / "examples" / "own_cpp_model"
CMAKE = shutil.which("cmake", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
MODULUS = 0.01  # N/mm for each mm² of surface


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    build = tmp_path_factory.mktemp("own")
    for command in (
        ["-S", SOURCE, "-B", build, f"-DPython_EXECUTABLE={sys.executable}", "-DCMAKE_CXX_FLAGS=-O1"],
        ["--build", build],
    ):
        done = subprocess.run([CMAKE, *command], capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
    sys.path[:0] = [str(build), str(SOURCE)]
    yield importlib.import_module("winkler")
    del sys.path[:2]


@pytest.fixture(scope="module")
def model(example):
    return example.Winkler(example.block(), MODULUS)


def test_the_loop_feels_the_foundation_s_force(example, capsys):
    """Weights w = (1 - r²/R²)² over a flat foundation of modulus k: the force is d (∫w dA)² k / ∫w² dA = 5π/9 k R² d.

    The contact's weights are integrals, but this model's springs stand at the nodes: an error of second order in the edge,
    1.7 % with eight edges a radius.
    """
    force, exact = example.main()
    assert force == pytest.approx(exact, rel=0.02)
    assert exact == pytest.approx(5 * np.pi / 9 * 0.01 * 12**2 * 2)
    with capsys.disabled():
        print(capsys.readouterr().out.splitlines()[-1])  # the rate of the loop is measured, not asserted


@pytest.mark.parametrize("spread", [0.0, 6.0, 25.0])
def test_springs_are_in_balance_with_the_tools(model, spread):
    """Stiffness of a node times its displacement is the tools' force there; a patch moves as prescribed."""
    centre = model.tissue.mesh.nodes.max(axis=0) * (0.5, 0.5, 1)
    points = [centre - (spread / 2 + 1, 0, 0), centre + (spread / 2 + 1, 0, 0)]
    pushed = np.array([[0.3, 0.0, -2.0], [0.0, -0.5, -1.0]])
    answer = model.push(points, pushed, [9.0, 7.0])
    surface, u = model.tissue.surface, answer.displacement
    load = np.zeros_like(u)
    for point, radius, moved, force in zip(points, (9.0, 7.0), pushed, answer.force, strict=True):
        patch = surface.patch(surface.closest(np.asarray(point)), radius)
        np.testing.assert_allclose(patch.weights @ u[patch.nodes], moved, atol=1e-12)
        load[patch.nodes] -= np.outer(patch.weights, force)
    springs = np.zeros_like(u)
    springs[surface.nodes] = MODULUS * surface.areas[:, None] * u[surface.nodes]
    np.testing.assert_allclose(springs, load, atol=1e-12 * np.abs(load).max())
    assert not u[model.tissue.held].any()


def test_contacts_that_cannot_be_told_apart_are_refused(model):
    surface = model.tissue.surface
    patch = surface.patch(surface.closest(model.tissue.mesh.nodes.max(axis=0) * (0.5, 0.5, 1)), 9.0)
    with pytest.raises(ValueError, match="told apart"):
        model.native.relax_all(model.start(), [patch, patch], 2, np.ones((2, 3)), 1)


def test_the_headers_are_where_palpate_says():
    assert (Path(pp.include()) / "tissue" / "tissue_model.h").is_file()
