"""Which model is needed: what is said of each is what it does."""

import re

import numpy as np
import pytest
from support.brick_meshes import block, brick
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.tissue.model_selection import SKIPPED
from palpate.tissue.spring_fitting import scattered_points, surface_normals, tilt_half

TISSUE = block(6, poisson=0.4)
ASKED = {"within": 0.3, "force": 0.05, "depth": 6.0, "radius": 15.0, "contacts": 3, "element": "smoothed"}


@pytest.fixture(scope="module")
def found():
    return pp.select_model(TISSUE, **ASKED)


def errors(name, sweeps):
    """Worst node in mm and worst share of force, on pushes made anew."""
    points = scattered_points(TISSUE, SKIPPED + 3)[SKIPPED:]
    pushes = tilt_half(-6.0 * surface_normals(TISSUE, points))
    model, truth = pp.model(TISSUE, name), pp.finite_elements(TISSUE)
    pairs = [
        (model.push(x, w, 15.0, tolerance=1e-6, most_sweeps=sweeps), truth.push(x, w, 15.0))
        for x, w in zip(points, pushes, strict=True)
    ]
    gap = [np.linalg.norm(a.displacement - b.displacement, axis=1).max() for a, b in pairs]
    off = [np.linalg.norm(a.force - b.force) / np.linalg.norm(b.force) for a, b in pairs]
    return max(gap), max(off)


def test_each_is_as_good_as_is_said(found):
    assert [r.name for r in found.trials][:2] == ["springs", "blocks"]
    for rung in found.trials:
        gap, off = errors(rung.name, rung.sweeps)
        assert gap == pytest.approx(rung.displacement, rel=0.05, abs=1e-9)
        assert off == pytest.approx(rung.force, rel=0.05, abs=1e-9)
        assert rung.enough == (rung.displacement <= 0.3 and rung.force <= 0.05)


def test_springs_are_not_enough_and_elements_are(found):
    by_name = {r.name: r for r in found.trials}
    assert not by_name["springs"].enough
    assert by_name["blocks"].enough
    assert found.needed is not None
    assert found.needed.enough
    assert found.needed.seconds == min(r.seconds for r in found.trials if r.enough)
    half = errors("blocks", by_name["blocks"].sweeps // 2)
    assert half[0] > 0.3 or half[1] > 0.05  # it asks for no more than it must
    assert "springs: not, even with" in found.text()
    assert f"needed: {found.needed.name}, {found.needed.sweeps} sweeps" in found.text()


def test_a_finer_wish_takes_more_sweeps(found):
    finer = pp.select_model(TISSUE, **(ASKED | {"within": 0.01, "force": 0.001}), models=["blocks"])
    assert finer.trials[0].sweeps > {r.name: r.sweeps for r in found.trials}["blocks"]


def test_where_none_is_enough_that_is_said():
    none = pp.select_model(TISSUE, **(ASKED | {"within": 1e-9}), models=["springs"])
    assert none.needed is None
    assert "no model here is good enough" in none.text()


def test_at_finite_strain_the_finite_model_is_needed():
    deep = pp.select_model(
        TISSUE, **(ASKED | {"depth": 9.0, "within": 0.2}), strain="finite", models=["blocks", "neo-hookean"]
    )
    assert [r.enough for r in deep.trials] == [False, True]
    assert "smoothed, finite strain" in deep.text()
    with pytest.raises(ValueError, match="strain: 'plastic'"):
        pp.select_model(TISSUE, strain="plastic")


def test_the_meshs_error_is_part_of_the_models_error():
    """The exact solver of a mesh that is off by more than the force may be is not enough, and else has what is left."""
    asked = {"within": 1.0, "depth": 2.0, "radius": 15.0, "contacts": 2, "models": ["compliance", "blocks"]}
    off = pp.force_error_map(TISSUE, 15.0)
    assert off.cautious > 0.03
    coarse = pp.select_model(TISSUE, force=off.cautious - 0.001, **asked)
    assert coarse.needed is None
    assert coarse.trials[0].force < 1e-6
    assert "needed: a finer mesh" in coarse.text()
    fine = pp.select_model(TISSUE, force=off.cautious + 0.005, **asked)
    assert fine.needed is not None
    assert all(one.force <= 0.005 for one in fine.trials)
    blocks = pp.select_model(TISSUE, force=off.cautious + 0.005, element="smoothed", **asked).trials[1]
    assert blocks.sweeps < fine.trials[1].sweeps


@pytest.mark.parametrize("name", ["within", "force", "depth", "contacts"])
def test_wishes_for_nothing_are_refused(name):
    with pytest.raises(ValueError, match=f"{name}: 0"):
        pp.select_model(TISSUE, **(ASKED | {name: 0}))
    with pytest.raises(ValueError, match="cubic"):
        pp.select_model(TISSUE, models=["cubic"])


def test_the_command_says_which_model_is_needed(tmp_path):
    mesh = brick((4, 4, 4))
    pp.write_mesh(tmp_path / "mesh.vtu", mesh)
    words = ["fit", tmp_path / "mesh.vtu", "--young", 3, "--within", 0.5, "--up-to", 4, "-o", tmp_path / "tissue.vtu"]
    words += ["--map", tmp_path / "map.png"]
    done = CliRunner().invoke(app, list(map(str, words)))
    assert done.exit_code == 0, done.output
    assert "within 0.5 mm and 5 % of force, pushes up to 4 mm" in done.output
    assert "needed: a finer mesh" in done.output
    assert "palpate mesh LABELS --within 3 --radius" in done.output
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    done = CliRunner().invoke(app, [*map(str, words), "--force-within", "90", "--radius", "20"])
    assert "patch radius 20 mm" in done.output
    assert "for a contact radius of 20 mm" in done.output
    assert "finer" not in done.output
    assert re.search(r"needed: [\w-]+, \d+ sweeps", done.output)
