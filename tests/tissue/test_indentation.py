"""Stiffness from the force of an indenter: against punch and sphere on a half space, and the statistics of its interval."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import jv
from support.brick_meshes import block, brick
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.errors import DataError, FileError
from palpate.tissue.indentation import PATCH, fit_curve, punch_stiffness, surface_curvature
from palpate.tissue.models.compliance import ComplianceModel

TOP = np.zeros(3)
YOUNG, POISSON = 5.0, 0.3  # kPa
REDUCED = 1e-3 * YOUNG / (1 - POISSON**2)  # N/mm²


@pytest.fixture(scope="module")
def half_space():
    """A block of half-width and depth 20 mm, finest at the origin of its top, held all round but there."""
    size, grading, n = 20.0, 4.2, 16
    mesh = brick((n, n, n // 2), (2.0, 2.0, 1.0))
    nodes = size * np.sinh(grading * (mesh.nodes - 1)) / np.sinh(grading)
    inside = (nodes[:, 2] > -size * (1 - 1e-9)) & (np.abs(nodes[:, :2]) < size * (1 - 1e-9)).all(axis=1)
    return pp.Tissue(pp.TetMesh(nodes, mesh.tets), YOUNG, POISSON, ~inside)


def test_a_patch_is_as_compliant_as_its_transform_says():
    square = quad(lambda x: (48 * jv(3, x) / x**3) ** 2, 1e-6, 300, limit=800)[0]
    assert pytest.approx(square / np.pi, rel=1e-5) == PATCH


def test_a_flat_punch_is_sneddons(half_space):
    """F = 2 E* a d. A finite block is stiffer than the half space, by the ratio of radius and size."""
    radius, depth = 0.8, np.linspace(0.0, 0.1, 30)
    curve = pp.IndentationCurve(depth, 1.7 * 2 * REDUCED * radius * depth)
    found = pp.fit_indentation(half_space, curve, TOP, punch=radius)
    assert 0.93 * 1.7 * YOUNG < found.young < 1.01 * 1.7 * YOUNG
    assert found.misfit < 1e-9
    np.testing.assert_allclose(found.tissue.young, found.young)


def test_a_sphere_is_hertzs(half_space):
    """F = 4/3 E* √R d^1.5: the curve is bent as it must be, and its stiffness found."""
    radius, depth = 8.0, np.linspace(0.0, 0.08, 60)
    curve = pp.IndentationCurve(depth, 1.7 * 4 / 3 * REDUCED * np.sqrt(radius) * depth**1.5)
    found = pp.fit_indentation(half_space, curve, TOP, sphere=radius)
    assert 0.93 * 1.7 * YOUNG < found.young < 1.01 * 1.7 * YOUNG
    assert found.misfit < 0.02


def test_stiffness_grows_with_the_radius_and_not_faster_than_it(half_space):
    radii, stiffness, error = punch_stiffness(ComplianceModel(half_space), TOP, 1.6)
    assert (np.diff(stiffness) > 0).all()
    per_radius = stiffness[1:] / radii[1:]
    np.testing.assert_allclose(per_radius, 2 * REDUCED, rtol=0.15)
    assert abs(error) < 0.15


def test_the_curvature_of_a_bowl():
    """Half a shell between 20 and 32 mm: outside 1/32, inside -1/20."""
    grid = pp.Grid(shape=(38, 72, 72), spacing=(1.0, 1.0, 1.0), origin=(-35.5, -35.5, -35.5))
    z, y, x = np.meshgrid(*[grid.axis(name) for name in "zyx"], indexing="ij")
    distance = np.sqrt(x**2 + y**2 + z**2)
    bowl = (distance < 32) & (distance > 20) & (z < 0)
    mesh = pp.tetrahedralize(pp.Labels(bowl.astype(np.uint8), grid), 1, edge=4.0)
    tissue = pp.Tissue(mesh, 5.0, 0.4, pp.resting_on(mesh, (0, 0, 1)))
    way = np.array([0.2, 0.1, -1.0]) / np.linalg.norm([0.2, 0.1, -1.0])
    assert surface_curvature(tissue, 32 * way) == pytest.approx(1 / 32, rel=0.25)
    assert surface_curvature(tissue, 20 * way) == pytest.approx(-1 / 20, rel=0.25)
    curve = pp.IndentationCurve(np.linspace(0, 1, 9), np.linspace(0, 1, 9))
    with pytest.raises(DataError, match="does not fit into the hollow"):
        pp.fit_indentation(tissue, curve, 20 * way, sphere=30.0)


@pytest.fixture(scope="module")
def punched():
    """Of a cube: the model's own force for 1 kPa of its modulus, at 40 depths."""
    tissue = block(6, young=4.0, poisson=0.45)
    at, depth = (25.0, 25.0, 50.0), np.linspace(-0.4, 2.0, 49)
    stiffness = punch_stiffness(ComplianceModel(tissue), at, 9.0)[1][-1]
    return tissue, at, depth, stiffness * np.maximum(depth, 0)


@pytest.mark.parametrize("find_onset", [False, True])
def test_the_interval_holds_the_truth_as_often_as_it_says(punched, find_onset):
    _, _, depth, force = punched
    stiffness = force[-1] / depth[-1]
    rng, held, runs = np.random.default_rng(3), 0, 300
    for _ in range(runs):
        noisy = 1.3 * force + 0.004 * rng.standard_normal(len(depth)) + 0.05 * find_onset
        curve = pp.IndentationCurve(depth + 0.15 * find_onset, noisy)
        found = fit_curve(curve, lambda d: stiffness * np.maximum(d, 0), find_onset)
        held += abs(found.factor - 1.3) <= found.half
        if find_onset:
            assert found.onset == pytest.approx(0.15, abs=0.1)
            assert found.offset == pytest.approx(0.05, abs=0.01)
    assert 0.92 <= held / runs <= 0.98


def test_a_wandering_force_widens_the_interval(punched):
    """Noise that is correlated along the curve tells less than as much white noise."""
    _, _, depth, force = punched
    stiffness = force[-1] / depth[-1]
    rng = np.random.default_rng(5)
    white = rng.standard_normal(len(depth))
    wander = np.convolve(rng.standard_normal(len(depth) + 20), np.ones(21), "valid")
    width = []
    for noise in (white, wander):
        curve = pp.IndentationCurve(depth, force + 0.02 * noise / noise.std())
        width.append(fit_curve(curve, lambda d: stiffness * np.maximum(d, 0)).half)
    assert width[1] > 1.5 * width[0]


def test_regions_keep_their_ratio_and_nothing_else_changes():
    mesh = brick((4, 4, 4), region=lambda centre: np.where(centre[:, 2] > 25, 1, 2))
    tissue = pp.Tissue(mesh, {1: 3.0, 2: 12.0}, 0.4, mesh.nodes[:, 2] == 0, relaxation=pp.Relaxation((0.3,), (0.1,)))
    curve = pp.IndentationCurve(np.linspace(0, 1, 9), np.linspace(0, 1, 9))
    found = pp.fit_indentation(tissue, curve, (25.0, 25.0, 50.0), punch=12.0)
    np.testing.assert_allclose(found.tissue.young / tissue.young, found.young / 3.0)
    assert found.tissue.relaxation == tissue.relaxation
    deep = found.tissue.mesh.nodes[:, 2].max()
    again = pp.fit_indentation(found.tissue, curve, (25.0, 25.0, deep), punch=12.0)
    assert again.young == pytest.approx(found.young, rel=1e-6)  # a second fit changes nothing


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "is empty"),
        ("depth,force\n0,0\n", "no column of depth with its unit"),
        ("depth mm,force kg\n0,0\n", "no column of force with its unit"),
        ("depth mm,depth mm,force N\n0,0,0\n", "2 column of depth"),
        ("depth mm,force N\n0,0\n1,x\n", "line 3: force is no number"),
        ("depth mm,force N\n0,0\n1\n", "line 3: force is no number"),
        ("depth mm,force N\n0,0\n1,1\n", "5 or more pairs"),
        ("depth mm,force N\n" + "1,0\n" * 6, "depth never changes"),
        ("depth mm,force N\n" + "1,nan\n" * 6, "force: 6 values are not finite"),
    ],
)
def test_what_is_no_curve_is_refused(tmp_path, text, complaint):
    (tmp_path / "curve.csv").write_text(text)
    with pytest.raises(FileError, match=complaint):
        pp.read_indentation(tmp_path / "curve.csv")


def test_units_and_separators(tmp_path):
    (tmp_path / "curve.csv").write_text(
        "# a robot's\ntime s; force [mN]; depth (um)\n" + "0; 5; 250\n" * 2 + "0;1;1\n" * 3
    )
    curve = pp.read_indentation(tmp_path / "curve.csv")
    np.testing.assert_allclose(curve.force[:2], 5e-3)
    np.testing.assert_allclose(curve.depth[:2], 0.25)


def test_what_is_no_indenter_is_refused(punched):
    tissue, at, depth, force = punched
    curve = pp.IndentationCurve(depth, force)
    for indenter, complaint in (
        ({}, "a sphere or of a punch"),
        ({"sphere": 3, "punch": 3}, "not both"),
        ({"punch": -1.0}, "more than 0"),
        ({"sphere": np.nan}, "more than 0"),
    ):
        with pytest.raises(DataError, match=complaint):
            pp.fit_indentation(tissue, curve, at, **indenter)
    with pytest.raises(DataError, match="does not rise"):
        pp.fit_indentation(tissue, pp.IndentationCurve(depth, -force), at, punch=9.0)
    with pytest.raises(DataError, match="largest depth"):
        pp.fit_indentation(tissue, pp.IndentationCurve(-np.abs(depth) - 1, force), at, punch=9.0)


def test_the_command_writes_tissue_and_picture(punched, tmp_path):
    tissue, _, depth, force = punched
    pp.write_tissue(tmp_path / "tissue.vtu", tissue)
    rows = "\n".join(f"{d},{1e3 * 1.5 * f}" for d, f in zip(depth, force, strict=True))
    (tmp_path / "curve.csv").write_text(f"depth mm,force mN\n{rows}\n")
    words = [
        "indent",
        "curve.csv",
        "tissue.vtu",
        "--at",
        "25,25,50",
        "--punch",
        "9",
        "-o",
        "new.vtu",
        "--plot",
        "fit.png",
    ]
    words = [str(tmp_path / word) if "." in word and not word.startswith("-") else word for word in words]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "Young's modulus 6 kPa" in done.output
    np.testing.assert_allclose(pp.read_tissue(tmp_path / "new.vtu").young, 6.0, rtol=1e-6)
    assert (tmp_path / "fit.png").read_bytes()[:4] == b"\x89PNG"
