"""Young's modulus of each tetrahedron from a map of the stiffness."""

import numpy as np
import pytest
from support.brick_meshes import brick
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.errors import DataError, MaterialError
from palpate.tissue.stiffness_map import lattice

PLAIN = brick((4, 4, 4), region=lambda c: np.where(c[:, 2] > 30, 2, 1))  # 0 to 50 mm
MESH = pp.TetMesh(PLAIN.nodes, PLAIN.tets, PLAIN.region, {1: "organ", 2: "lump"})
CENTROIDS = MESH.nodes[MESH.tets].mean(axis=1)
GRID = pp.Grid((30, 31, 32), (2.0, 2.1, 1.9), origin=(-4, -5, -3))


def on(grid, f, unit="kPa"):
    z, y, x = np.meshgrid(*map(np.arange, grid.shape), indexing="ij")
    points = grid.points(np.stack([z.ravel(), y.ravel(), x.ravel()], axis=1))
    return pp.Volume(f(points).reshape(grid.shape), grid, unit)


def linear(points):
    return 5 + points @ [0.02, 0.03, -0.04]


@pytest.mark.parametrize("steps", range(2, 7))
def test_the_points_have_the_moments_of_a_tetrahedron(steps):
    points = lattice(steps)
    assert len(points) == steps * (steps + 1) * (steps + 2) // 6
    np.testing.assert_allclose(points.sum(axis=1), 1)
    np.testing.assert_allclose(points.mean(axis=0), 0.25)
    np.testing.assert_allclose(points.T @ points / len(points), (1 + np.eye(4)) / 20)  # of a, b: 1/20, of a, a: 1/10
    assert points.min() > 0


def test_the_mean_of_a_linear_map_is_its_value_at_the_centroid():
    found = pp.stiffness_from_map(MESH, on(GRID, linear), quantity="young")
    np.testing.assert_allclose(found, linear(CENTROIDS), rtol=1e-6)
    assert np.ptp(found) > 1


def test_the_mean_of_a_square_nears_its_integral():
    """Over a tetrahedron, the mean of x² is (Σ x_i² + (Σ x_i)²) / 20."""
    x = MESH.nodes[MESH.tets][:, :, 0]
    exact = 1 + ((x**2).sum(axis=1) + x.sum(axis=1) ** 2) / 20 / 100
    found = pp.stiffness_from_map(MESH, on(GRID, lambda p: 1 + p[:, 0] ** 2 / 100), quantity="young")
    centre = 1 + CENTROIDS[:, 0] ** 2 / 100
    np.testing.assert_array_less(np.abs(found - exact), 0.02 * 1.9**2 / 8 + 1e-6)  # of linear interpolation: f'' h²/8
    assert np.abs(centre - exact).max() > 8 * np.abs(found - exact).max()


def test_a_turned_grid_reads_the_same_places():
    angle = 0.4
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    grid = pp.Grid((30, 60, 60), (2, 2, 2), origin=np.array([25, 25, -3]) - turn @ [59, 59, 0], direction=turn)
    found = pp.stiffness_from_map(MESH, on(grid, linear), quantity="young")
    np.testing.assert_allclose(found, linear(CENTROIDS), rtol=1e-6)


@pytest.mark.parametrize("nu", [0.3, 0.45, {"organ": 0.2, "lump": 0.4}])
def test_a_shear_modulus_becomes_young_s(nu):
    """E = 2 (1 + nu) mu."""
    mu = pp.stiffness_from_map(MESH, on(GRID, linear), quantity="young")
    E = pp.stiffness_from_map(MESH, on(GRID, linear), quantity="shear", poisson=nu)
    ratio = np.where(MESH.region == 2, nu["lump"], nu["organ"]) if isinstance(nu, dict) else nu
    np.testing.assert_allclose(E, 2 * (1 + ratio) * mu, rtol=1e-12)


def test_poisson_s_ratio_is_that_of_the_named_tissue():
    E = pp.stiffness_from_map(MESH, on(GRID, linear), quantity="shear", tissue={"lump": "lung"})
    np.testing.assert_allclose(E / linear(CENTROIDS), np.where(MESH.region == 2, 2.86, 2.9), rtol=1e-6)


def test_voxels_of_zero_hold_no_measurement():
    """A map that is 0 beyond the organ gives the values of the organ at its surface too, not those of a rim of zeros."""

    def masked(points):
        return np.where(((points > -0.2) & (points < 50.2)).all(axis=1), 5.0, 0.0)

    np.testing.assert_allclose(pp.stiffness_from_map(MESH, on(GRID, masked), quantity="young"), 5, rtol=1e-6)


@pytest.mark.parametrize("lowest", [1, 25])
def test_a_map_that_does_not_cover_the_mesh_is_refused_with_the_share(lowest):
    small = pp.Grid((13, 60, 60), (2, 1, 1), origin=(-4, -4, lowest))  # z from 0 to 26, or 24 to 50, of 50 mm
    with pytest.raises(DataError, match=r"stiffness: (\d\d[.\d]*) % of the mesh lies outside") as refusal:
        pp.stiffness_from_map(MESH, on(small, linear), quantity="young")
    assert float(str(refusal.value).split()[1]) == pytest.approx(48, abs=3)
    far = pp.Grid((9, 9, 9), (2, 2, 2), origin=(500, 0, 0))
    with pytest.raises(DataError, match=r"stiffness: 100 % of the mesh"):
        pp.stiffness_from_map(MESH, on(far, lambda p: np.full(len(p), 5.0)), quantity="young")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda v: 1000 * v, r"stiffness: the median is \d+.*in Pa\? expected kPa; divide by 1000"),
        (lambda v: v / 1000, r"stiffness: the median is 0\.00\d+.*in MPa\? expected kPa; times 1000"),
        (lambda v: v - 6, r"stiffness: -[\d.]+ kPa at voxel \(\d+, \d+, \d+\).*inside the mesh.*expected positive"),
    ],
)
def test_values_that_cannot_be_are_refused(change, words):
    volume = on(GRID, linear)
    with pytest.raises(DataError, match=words):
        pp.stiffness_from_map(MESH, pp.Volume(change(volume.values), GRID), quantity="young")


def test_negative_values_far_from_the_mesh_do_not_matter():
    values = on(GRID, linear).values.copy()
    values[-1, -1, -1] = -3
    pp.stiffness_from_map(MESH, pp.Volume(values, GRID), quantity="young")


def test_what_the_map_holds_must_be_said():
    volume = on(GRID, linear)
    with pytest.raises(TypeError, match="quantity"):
        pp.stiffness_from_map(MESH, volume)
    with pytest.raises(DataError, match=r"quantity: 'mu' is not known.*shear.*young"):
        pp.stiffness_from_map(MESH, volume, quantity="mu")
    with pytest.raises(MaterialError, match="tissue: 'stone'"):
        pp.stiffness_from_map(MESH, volume, quantity="shear", tissue="stone")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    pp.write_mesh(tmp_path / "mesh.vtu", MESH)
    pp.write_volume(tmp_path / "map.nii.gz", on(GRID, linear))
    values = on(GRID, linear).values.copy()
    values[15, 15, 15] = np.nan
    import nibabel

    nibabel.Nifti1Image(values.T, np.diag([1.9, 2.1, 2.0, 1])).to_filename(tmp_path / "nan.nii.gz")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def command(words):
    return CliRunner().invoke(app, ["fit", "mesh.vtu", *words.split(), "-o", "tissue.vtu"], catch_exceptions=True)


def test_the_command_reads_a_map(folder):
    done = command("--stiffness map.nii.gz --quantity shear --tissue liver --rest-on 0,0,-1")
    assert done.exit_code == 0, done.output
    tissue = pp.read_tissue("tissue.vtu")
    np.testing.assert_allclose(tissue.young, 2.9 * linear(CENTROIDS), rtol=1e-5)
    assert tissue.materials == {1: "liver", 2: "liver"}
    assert "40 to 60 Hz" in done.output
    assert "stiffer there than under a slow press" in done.output
    assert "not from the table" in done.output


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        ("--stiffness map.nii.gz", ["--quantity: ''", "shear", "young"]),
        ("--quantity shear --young 5", ["--quantity", "--stiffness"]),
        ("--stiffness map.nii.gz --quantity young --young 5", ["--stiffness", "leave out", "--region-young"]),
        ("--stiffness none.nii.gz --quantity young", ["none.nii.gz", "no such file"]),
        ("--stiffness nan.nii.gz --quantity young", ["nan.nii.gz", "1 values are not finite"]),
    ],
)
def test_the_command_refuses_before_it_writes(folder, words, parts):
    refused = command(words)
    assert refused.exit_code != 0
    for part in parts:
        assert part in refused.output + str(refused.exception), refused.output + str(refused.exception)
    assert not (folder / "tissue.vtu").exists()
