"""What the spread of a tissue's stiffness makes of the force, against pushes of tissues that are stiffer and softer."""

import numpy as np
import pytest
from support.brick_meshes import brick
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.errors import MaterialError

POINT, RADIUS, PUSH = (22.0, 27.0, 50.0), 12.0, (0.4, 0.2, -1.5)


def lumpy(**more):
    """A block with a stiff ball below its top; its lower half is a region of its own."""

    def region(x):
        return np.where(np.linalg.norm(x - (25, 25, 38), axis=1) < 9, 3, 1 + (x[:, 2] < 20))

    mesh = brick((8, 8, 8), region=region)
    named = pp.TetMesh(mesh.nodes, mesh.tets, mesh.region, {1: "organ", 2: "base", 3: "lump"})
    return pp.Tissue(named, {1: 5.0, 2: 8.0, 3: 40.0}, {1: 0.45, 2: 0.3, 3: 0.49}, mesh.nodes[:, 2] == 0, **more)


def along(tissue):
    """N: the force of the push along it, by a direct solution."""
    return float(pp.finite_elements(tissue).push(POINT, PUSH, RADIUS).force @ PUSH)


def spread_of(tissue, name="compliance"):
    return pp.model(tissue, name).push(POINT, PUSH, RADIUS, tolerance=1e-6).estimate.stiffness


@pytest.mark.parametrize("element", ["smoothed", "P1"])
def test_it_is_the_change_of_the_force_when_each_region_is_stiffer(element):
    tissue = lumpy(element=element)
    relative = {1: 0.2, 2: 0.1, 3: 0.5}
    variance = 0.0
    for region, share in relative.items():
        inside, step = tissue.mesh.region == region, 1e-4
        up, down = (along(tissue.replace(young=tissue.young * np.where(inside, 1 + s, 1))) for s in (step, -step))
        variance += (share * (up - down) / (2 * step) / along(tissue)) ** 2
    known = tissue.replace(young_spread={r: s * tissue.young[tissue.mesh.region == r][0] for r, s in relative.items()})
    assert spread_of(known) == pytest.approx(np.sqrt(variance), rel=1e-4)
    assert spread_of(known, "blocks") == pytest.approx(np.sqrt(variance), rel=1e-3)


def test_it_is_the_standard_deviation_of_drawn_stiffnesses():
    tissue = lumpy(young_spread={"organ": 0.5, "base": 0.8, "lump": 8.0})
    rng, forces = np.random.default_rng(5), []
    for _ in range(200):
        factor = 1 + rng.standard_normal(3) * (0.1, 0.1, 0.2)
        forces.append(along(tissue.replace(young=tissue.young * factor[tissue.mesh.region - 1])))
    drawn = np.std(forces) / abs(np.mean(forces))
    assert spread_of(tissue) == pytest.approx(drawn, rel=4 / np.sqrt(2 * len(forces)))  # four standard errors


def test_of_one_region_it_is_that_of_the_stiffness():
    assert spread_of(
        lumpy(young_spread=lumpy().young * 0.3, materials=dict.fromkeys((1, 2, 3), "fat"))
    ) == pytest.approx(0.3)


def test_regions_of_one_named_tissue_vary_together():
    given = {"organ": 1.0, "base": 1.6, "lump": 8.0}
    apart = spread_of(lumpy(young_spread=given))
    assert spread_of(lumpy(young_spread=given, materials={1: "liver", 2: "liver"})) > 1.1 * apart
    assert spread_of(lumpy(young_spread=given, materials={1: "liver", 2: "fat"})) == pytest.approx(apart)


def test_without_a_spread_it_is_nothing_and_with_one_no_part_of_the_error():
    answer = pp.model(lumpy(), "compliance").push(POINT, PUSH, RADIUS)
    assert answer.estimate.stiffness == 0
    known = pp.model(lumpy(young_spread=1.0), "compliance").push(POINT, PUSH, RADIUS).estimate
    assert known.stiffness > 0.02
    assert known.total == pytest.approx(answer.estimate.total)


def test_it_stays_with_the_tissue(tmp_path):
    tissue = lumpy(young_spread={"organ": 1.0, "base": 0.0, "lump": 8.0})
    pp.write_tissue(tmp_path / "tissue.vtu", tissue)
    np.testing.assert_array_equal(pp.read_tissue(tmp_path / "tissue.vtu").young_spread, tissue.young_spread)
    cut = pp.cut(tissue, pp.Blade.swept([(10, 25, 51), (40, 25, 51)], (0, 0, -1), 15))
    np.testing.assert_array_equal(cut.young_spread, tissue.young_spread[cut.mesh.parent])
    mesh = pp.TetMesh(tissue.mesh.nodes + (90, 0, 0), tissue.mesh.tets, tissue.mesh.region, tissue.mesh.names)
    both = pp.join_tissues([tissue, tissue.replace(mesh=mesh)])
    np.testing.assert_array_equal(both.young_spread, np.tile(tissue.young_spread, 2))


@pytest.mark.parametrize("given", [-1.0, np.nan, {"organ": 1.0}])
def test_what_is_no_spread_is_refused(given):
    with pytest.raises(ValueError, match="young_spread"):
        lumpy(young_spread=given)


def test_a_named_tissue_has_the_spread_of_its_source_unless_one_is_given():
    mesh, fixed = lumpy().mesh, lumpy().fixed
    named = {"organ": "fat", "base": "fat", "lump": "breast-carcinoma"}
    fitted = pp.fit(mesh, fixed=fixed, tissue=named)
    lump = mesh.region == 3
    for inside, name in ((~lump, "fat"), (lump, "breast-carcinoma")):
        known = pp.tissue_properties(name).young
        assert (fitted.young[inside] == known.value).all()
        assert known.spread > 0
        assert (fitted.young_spread[inside] == known.spread).all()
    assert (pp.fit(mesh, 7.0, fixed=fixed, tissue=named).young_spread == 0).all()  # whose stiffness it is not
    given = pp.fit(mesh, fixed=fixed, tissue=named, young_spread={"lump": 2.0})
    assert set(given.young_spread[lump]) == {2.0}
    assert set(given.young_spread[~lump]) == {pp.tissue_properties("fat").young.spread}
    with pytest.raises(MaterialError, match=r"young_spread.*liver"):
        pp.fit(mesh, 7.0, fixed=fixed, young_spread={"liver": 2.0})


def test_the_command_takes_it_and_says_so(tmp_path):
    pp.write_mesh(tmp_path / "mesh.vtu", lumpy().mesh)
    words = ["--young", "5", "--region-young", "lump=40", "--young-spread", "0.5", "--region-young-spread", "lump=8"]
    out = tmp_path / "tissue.vtu"
    told = CliRunner().invoke(app, ["fit", str(tmp_path / "mesh.vtu"), *words, "-o", str(out)])
    assert told.exit_code == 0, told.output
    assert "organ 5 ± 0.5 kPa, base 5 ± 0.5 kPa, lump 40 ± 8 kPa" in " ".join(told.output.split())
    found = pp.read_tissue(out)
    np.testing.assert_array_equal(found.young_spread, np.where(found.mesh.region == 3, 8.0, 0.5))


def test_a_stiffness_that_was_measured_has_the_spread_of_its_interval():
    tissue, depth = lumpy(), np.linspace(0, 2, 30)
    noisy = 0.4 * depth + np.random.default_rng(2).normal(0, 0.02, len(depth))
    found = pp.fit_indentation(tissue, pp.IndentationCurve(depth, noisy), POINT, punch=10)
    low, high = found.interval
    np.testing.assert_allclose(found.tissue.young_spread / found.tissue.young, (high - low) / 2 / 1.96 / found.young)
