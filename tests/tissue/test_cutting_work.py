"""The work of a blade: fracture mechanics of a cut beam, areas by region, and what cannot be."""

import numpy as np
import pytest
from support.blades import area_within
from support.brick_meshes import brick
from support.example_organs import organ

import palpate as pp

YOUNG, POISSON, WIDTH, ARM = 5.0, 0.3, 4.0, 8.0  # kPa; mm
LENGTH, CELL = 80.0, 2.0  # mm
KILOPASCAL = 1e-3  # N/mm²


def double_cantilever(crack):
    """Compliance of both arms together, mm/N: a beam held at its far end, cut along its middle, its arms pulled apart."""
    cells = int(LENGTH / CELL), int(WIDTH / CELL), int(2 * ARM / CELL)
    mesh = brick(cells, (LENGTH, WIDTH, 2 * ARM))
    tissue = pp.Tissue(mesh, YOUNG, POISSON, mesh.nodes[:, 0] == LENGTH)
    z = ARM + 0.01  # not through nodes
    blade = pp.Blade.swept([(-1, -1, z), (crack + CELL / 4, -1, z)], (0, 1, 0), WIDTH + 2)
    model = pp.model(pp.cut(tissue, blade), "compliance", contact=False)
    ends = [(0, WIDTH / 2, 1.5 * ARM), (0, WIDTH / 2, 0.5 * ARM)]
    force = model.push(ends, [(0, 0, 0.1), (0, 0, -0.1)], [3.0, 3.0]).force
    return 0.2 / np.abs(force[:, 2]).mean()


def test_the_energy_release_rate_of_a_double_cantilever_is_that_of_beam_theory():
    """G = P²/(2b) dC/da, where a + χh takes the place of a, since the arms turn at their root.

    χ is that of J. G. Williams (1989), which standards of delamination tests take over.
    """
    shear = YOUNG / (2 * (1 + POISSON))
    gamma = 1.18 * YOUNG / shear
    chi = np.sqrt(YOUNG / (11 * shear) * (3 - 2 * (gamma / (1 + gamma)) ** 2))
    cracks = np.array([24.0, 32.0, 40.0, 48.0])
    compliance = np.array([double_cantilever(crack) for crack in cracks])
    slope = np.diff(compliance) / np.diff(cracks)
    middle = (cracks[1:] + cracks[:-1]) / 2
    beam = 24 * (middle + chi * ARM) ** 2 / (YOUNG * KILOPASCAL * WIDTH * ARM**3)
    np.testing.assert_allclose(slope, beam, rtol=0.05)


@pytest.fixture(scope="module")
def whole():
    return organ(12)


@pytest.fixture(scope="module")
def top(whole):
    return whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]


def test_the_area_is_that_of_the_blade_within_the_body(whole, top):
    """Also of a second cut across the first one."""
    first = pp.incision(whole, [top - (15, 0, 0), top + (15, 0, 0)], depth=12)
    second = pp.incision(whole, [top - (5, 14, 0), top + (-5, 14, 0)], depth=10)
    once, twice = pp.cut(whole, first), pp.cut(whole, [first, second])
    for before, after, blade in [(whole, once, first), (once, twice, second)]:
        work = pp.cutting_work(before, after, toughness=1000, friction=0.25)
        assert work.area == pytest.approx(area_within(blade, whole.mesh), rel=0.01)
        assert work.fracture == pytest.approx(work.area)  # 1000 J/m² are 1 mJ/mm²
        assert work.friction == pytest.approx(work.area / 4)
        assert work.total == pytest.approx(1.25 * work.area)
        assert work.unknown == ()


def test_each_region_has_its_toughness():
    mesh = brick((8, 8, 8), region=lambda middle: np.where(middle[:, 0] < 25, 1, 2))
    mesh = pp.TetMesh(mesh.nodes, mesh.tets, mesh.region, {1: "soft", 2: "hard"})
    tissue = pp.Tissue(mesh, 5.0, 0.3, mesh.nodes[:, 2] == 0, materials={1: "liver"})
    after = pp.cut(tissue, pp.Blade.swept([(-1, 25.1, 60), (51, 25.1, 60)], (0, 0, -1), 30))
    given = pp.cutting_work(tissue, after, {"soft": 100, "hard": 300})
    assert given.area == pytest.approx(50 * 20, rel=0.01)
    assert given.fracture == pytest.approx(1e-3 * (100 + 300) * given.area / 2, rel=0.02)
    named = pp.cutting_work(tissue, after)
    liver = pp.tissue_properties("liver").fracture_energy.value
    assert named.fracture == pytest.approx(1e-3 * liver * named.area / 2, rel=0.02)
    assert named.unknown == ("hard",)
    some = pp.cutting_work(tissue, after, {"hard": 300})  # and the liver as it is by default
    assert some.fracture == pytest.approx(1e-3 * (liver + 300) * some.area / 2, rel=0.02)
    assert some.unknown == ()


def test_the_tissue_can_give_no_more_than_the_cut_takes():
    assert pp.CuttingWork(10, 5, 1, released=3).total == 3
    assert pp.CuttingWork(10, 5, 1, released=8).total == 1


def test_what_cannot_be_is_refused(whole):
    for options, said in [
        ({"toughness": -1}, "toughness: -1 J/m²"),
        ({"toughness": np.nan}, "toughness: nan"),
        ({"toughness": {"bone": 5}}, "no region 'bone'"),
        ({"friction": -0.1}, "friction: -0.1"),
    ]:
        with pytest.raises(pp.errors.MaterialError, match=said):
            pp.cutting_work(whole, whole, **options)
    with pytest.raises(pp.errors.MaterialError, match="toughness"):
        pp.Session(pp.model(whole, "compliance"), radius=8, toughness=-1)
