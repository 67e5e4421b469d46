"""Fitting springs, its report, its file, its command; and the lump."""

import meshio
import numpy as np
import pytest
from support.brick_meshes import brick
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.tissue.lump_detectability import THRESHOLDS, without_region
from palpate.tissue.models.mass_spring import SpringModel
from palpate.tissue.spring_fitting import compare

MESH = brick((6, 6, 6), region=lambda c: np.where(np.linalg.norm(c - [25, 25, 33], axis=1) < 11, 2, 1))


@pytest.fixture(scope="module")
def fitted():
    named = pp.TetMesh(MESH.nodes, MESH.tets, MESH.region, {1: "fat", 2: "lump"})
    return pp.fit(named, {"fat": 3.25, "lump": 42.5}, 0.4, MESH.nodes[:, 2] == 0)


def test_the_fit_beats_springs_that_were_not_fitted(fitted):
    truth = pp.finite_elements(fitted)
    r = fitted.report
    loose = compare(
        truth, SpringModel(fitted, pp.SpringLaw(scale=fitted.springs.scale)), r.points, r.push, r.radius, r.depth
    )
    assert np.sqrt((r.rms**2).mean()) < np.sqrt((loose.rms**2).mean())
    assert np.sqrt((r.force_error**2).mean()) < 0.5
    assert (r.truth_force * r.push).sum(axis=1).max() < 0


def test_the_report_is_the_difference_to_finite_elements(fitted):
    r = fitted.report
    model, truth = pp.model(fitted, "springs"), pp.finite_elements(fitted)
    gaps = [
        np.linalg.norm(model.push(x, w, r.radius).displacement - truth.push(x, w, r.radius).displacement, axis=1)
        for x, w in zip(r.points, r.push, strict=True)
    ]
    np.testing.assert_allclose(r.worst, [g.max() for g in gaps], rtol=1e-6)
    np.testing.assert_allclose(r.error_map, np.max(gaps, axis=0), atol=1e-6)
    assert f"{r.worst[:4].max():.2f} mm" in r.text()
    assert "smoothed" in r.text()


def test_the_force_scale_leaves_the_displacement_alone(fitted):
    from dataclasses import replace

    r = fitted.report
    twice = SpringModel(fitted, replace(fitted.springs, scale=2 * fitted.springs.scale))
    a, b = (m.push(r.points[0], r.push[0], r.radius, tolerance=1e-6) for m in (pp.model(fitted, "springs"), twice))
    np.testing.assert_allclose(b.force, 2 * a.force, rtol=1e-9)
    np.testing.assert_allclose(b.displacement, a.displacement, atol=1e-9)


def test_tissue_survives_its_file(fitted, tmp_path):
    path = tmp_path / "tissue.vtu"
    pp.write_tissue(path, fitted)
    again = pp.read_tissue(path)
    for name in ("nodes", "tets", "region"):
        np.testing.assert_array_equal(getattr(again.mesh, name), getattr(fitted.mesh, name))
    for name in ("young", "poisson", "fixed"):
        np.testing.assert_array_equal(getattr(again, name), getattr(fitted, name))
    assert again.mesh.names == fitted.mesh.names
    assert again.springs == fitted.springs
    assert again.report.text() == fitted.report.text()
    np.testing.assert_array_equal(again.report.error_map, fitted.report.error_map)


def test_others_can_open_the_file(fitted, tmp_path):
    path = tmp_path / "tissue.vtu"
    pp.write_tissue(path, fitted)
    stored = meshio.read(path)
    np.testing.assert_array_equal(stored.cell_data["young"][0], fitted.young)
    np.testing.assert_array_equal(stored.point_data["fixed"], fitted.held)
    np.testing.assert_array_equal(stored.point_data["error"], fitted.report.error_map)


def test_tissue_without_springs_survives_too(tmp_path):
    plain = pp.Tissue(MESH, 5, 0.3, MESH.nodes[:, 2] == 0, element="P2")
    pp.write_tissue(tmp_path / "plain.vtu", plain)
    again = pp.read_tissue(tmp_path / "plain.vtu")
    assert again.element == "P2"
    assert again.springs is None
    assert again.report is None


def test_files_that_are_not_tissue_are_refused(fitted, tmp_path):
    with pytest.raises(OSError, match=r"nowhere.vtu.*no such file"):
        pp.read_tissue(tmp_path / "nowhere.vtu")
    with pytest.raises(OSError, match=r"tissue.stl.*vtu"):
        pp.write_tissue(tmp_path / "tissue.stl", fitted)
    meshio.Mesh(MESH.nodes, [("tetra", MESH.tets)]).write(tmp_path / "bare.vtu")
    with pytest.raises(OSError, match=r"bare.vtu.*young.*fixed.*palpate fit"):
        pp.read_tissue(tmp_path / "bare.vtu")
    pp.write_tissue(tmp_path / "whole.vtu", fitted)
    (tmp_path / "cut.vtu").write_bytes((tmp_path / "whole.vtu").read_bytes()[:5000])
    with pytest.raises(OSError, match=r"cut.vtu.*truncated"):
        pp.read_tissue(tmp_path / "cut.vtu")
    with pytest.raises(OSError, match=r"tissue.msh.*vtu"):
        pp.read_tissue(tmp_path / "tissue.msh")
    assert {p.name for p in tmp_path.iterdir()} == {"bare.vtu", "whole.vtu", "cut.vtu"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"depth": -1.0}, ["depth", "-1"]),
        ({"law": "cubic"}, ["law", "cubic", "exponential"]),
        ({"young": -3.0}, ["young", "-3"]),
        ({"fixed": np.arange(len(MESH.nodes))}, ["fixed", "all nodes are held"]),
    ],
)
def test_fits_that_cannot_be_are_refused(arguments, words):
    given = {"young": 5.0, "poisson": 0.3, "fixed": MESH.nodes[:, 2] == 0} | arguments
    with pytest.raises(ValueError) as refusal:
        pp.fit(MESH, **given)
    for word in words:
        assert word in str(refusal.value)


@pytest.fixture(scope="module")
def lump():
    mesh = brick((10, 10, 8), region=lambda c: np.where(np.linalg.norm(c - [25, 25, 40], axis=1) < 6, 2, 1))
    tissue = pp.Tissue(mesh, {1: 3.25, 2: 42.5}, 0.45, mesh.nodes[:, 2] == 0)
    return tissue, pp.lump_map(tissue, 2, depth=3.0, radius=9.0, most=30)


def test_the_lump_is_felt_above_itself(lump):
    _, found = lump
    where = found.points[np.argmax(found.difference)]
    assert where[2] == 50
    assert np.linalg.norm(where[:2] - 25) < 6
    assert found.difference.max() > 0.1
    far = np.linalg.norm(found.points - [25, 25, 50], axis=1) > 30
    assert far.any()
    assert np.abs(found.difference[far]).max() < 0.05


def test_the_model_reproduces_the_lump(lump):
    tissue, found = lump
    assert len(found.checked) in (8, 9)
    assert np.argmax(found.difference) in found.checked
    assert found.model_gap < 0.10
    k = int(found.checked[0])
    exact = pp.finite_elements(tissue).push(found.points[k], -3.0 * found.normals[k], 9.0)
    assert -exact.force @ -found.normals[k] == pytest.approx(found.stiff[k], rel=1e-9)


def test_the_verdict_follows_the_published_thresholds(lump):
    _, found = lump
    from dataclasses import replace

    assert [p for p, _ in THRESHOLDS] == sorted(p for p, _ in THRESHOLDS)
    for rise, word in ((1.05, "could not tell"), (1.1, "may feel it"), (1.3, "could feel it")):
        exact = np.zeros(len(found.checked))
        assert word in replace(found, stiff=found.plain * rise, mesh_stiff=exact, mesh_plain=exact).text()
        off = replace(found, stiff=found.plain * 1.5 * rise, mesh_stiff=exact + 0.5, mesh_plain=exact)
        assert word in off.text()


def test_without_the_region_the_tissue_is_even(lump):
    tissue, _ = lump
    even = without_region(tissue, 2)
    np.testing.assert_allclose(even.young, 3.25)
    with pytest.raises(ValueError, match=r"region 7.*nowhere"):
        without_region(tissue, 7)


def command(*words):
    return CliRunner().invoke(app, ["fit", *map(str, words)], catch_exceptions=True)


def test_the_command_fits_a_mesh_and_prints_the_report(tmp_path):
    named = pp.TetMesh(MESH.nodes, MESH.tets, MESH.region, {1: "organ", 2: "lump"})
    pp.write_mesh(tmp_path / "mesh.vtu", named)
    out = tmp_path / "tissue.vtu"
    done = command(tmp_path / "mesh.vtu", "--young", 3, "--rest-on", "0,0,-1", "--region-young", "lump=20", "-o", out)
    assert done.exit_code == 0, done.output
    tissue = pp.read_tissue(out)
    np.testing.assert_array_equal(tissue.young, np.where(MESH.region == 2, 20.0, 3.0))
    np.testing.assert_array_equal(tissue.poisson, 0.45)
    np.testing.assert_array_equal(tissue.held, MESH.nodes[:, 2] == 0)
    assert tissue.report.text() in done.output
    assert command("--help").output.count("palpate fit kidney.vtu --young 15 --rest-on") == 1


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--young", -3], ["young", "-3", "positive"]),
        (["--young", 3, "--poisson", 0.5], ["poisson", "0.5", "mixed"]),
        (["--young", 3, "--rest-on", "0,0"], ["--rest-on", "0,0", "three numbers"]),
        (["--young", 3, "--rest-on", "0,0,0"], ["direction", "points nowhere"]),
        (["--young", 3, "--region-young", "liver=4"], ["--region-young", "liver=4", "regions 1"]),
        (["--young", 3, "--region-young", "9=4"], ["young", "9", "regions are 1"]),
        (["--young", 3, "--law", "cubic"], ["law", "cubic", "exponential"]),
    ],
)
def test_the_command_refuses_before_it_writes(tmp_path, words, parts):
    pp.write_mesh(tmp_path / "mesh.vtu", brick((2, 2, 2)))
    refused = command(tmp_path / "mesh.vtu", *words, "-o", tmp_path / "tissue.vtu")
    assert refused.exit_code != 0
    said = refused.output + str(refused.exception)
    for part in parts:
        assert part in said
    assert [p.name for p in tmp_path.iterdir()] == ["mesh.vtu"]


def test_the_command_refuses_files_that_cannot_be(tmp_path):
    pp.write_mesh(tmp_path / "mesh.vtu", brick((2, 2, 2)))
    for mesh, out, part in [
        (tmp_path / "none.vtu", tmp_path / "t.vtu", "no such file"),
        (tmp_path / "mesh.vtu", tmp_path / "no" / "t.vtu", "does not exist"),
        (tmp_path / "mesh.vtu", tmp_path / "t.stl", "written as .vtu"),
    ]:
        refused = command(mesh, "--young", 3, "-o", out)
        assert refused.exit_code != 0
        assert part in str(refused.exception)
    assert [p.name for p in tmp_path.iterdir()] == ["mesh.vtu"]
