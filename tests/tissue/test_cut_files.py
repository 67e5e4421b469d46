"""Cut tissue on disk, along a surface, by command, and as a picture."""

import sys

import meshio
import numpy as np
import pytest
from support.brick_meshes import brick
from support.example_organs import organ

import palpate as pp
from palpate.commands import main


@pytest.fixture(scope="module")
def whole():
    return organ(7)


@pytest.fixture(scope="module")
def top(whole):
    return whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]


@pytest.fixture(scope="module")
def opened(whole, top):
    return pp.cut(whole, pp.incision(whole, [top - (15, 0, 0), top + (0, 4, 0), top + (15, 0, 0)], depth=12))


def test_a_cut_tissue_reads_back_to_the_same_forces(opened, top, tmp_path):
    path = tmp_path / "cut.vtu"
    pp.write_tissue(path, opened)
    back = pp.read_tissue(path)
    for name in ("nodes", "tets", "region", "share", "side", "body", "origin", "parent"):
        assert np.array_equal(getattr(back.mesh, name), getattr(opened.mesh, name)), name
    for name in ("triangles", "lip", "tet", "weight"):
        assert np.array_equal(getattr(back.mesh.skin, name), getattr(opened.mesh.skin, name)), name
    assert back.mesh.names == opened.mesh.names
    push = top + (0, 8, 0), (0.2, 0.1, -2), 8
    forces = [pp.model(t, "compliance").push(*push).force for t in (opened, back)]
    assert np.allclose(*forces, rtol=1e-12)
    again = [pp.cut(t, pp.incision(t, [top - (0, 15, 0), top + (0, 15, 0)], depth=8)) for t in (opened, back)]
    assert np.array_equal(again[0].mesh.tets, again[1].mesh.tets)


def test_other_programs_see_share_and_side(opened, tmp_path):
    pp.write_tissue(tmp_path / "cut.vtu", opened)
    seen = meshio.read(tmp_path / "cut.vtu")
    assert np.array_equal(seen.cell_data["share"][0], opened.mesh.share)
    assert set(seen.cell_data["side"][0]) == {-1, 0, 1}


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("share", lambda m: m.cell_data["share"][0].__imul__(-1)),
        ("parent", lambda m: m.cell_data["parent"][0].__iadd__(10**6)),
        ("origin", lambda m: m.point_data["origin"].__iadd__(10**6)),
        ("skin", lambda m: m.field_data["skin tet"].__iadd__(10**6)),
        ("skin weight", lambda m: m.field_data["skin weight"].__imul__(2)),
    ],
)
def test_a_damaged_file_is_refused(opened, tmp_path, monkeypatch, name, change):
    from palpate.tissue import io

    path = tmp_path / "cut.vtu"
    pp.write_tissue(path, opened)
    stored = io.read_stored(path)
    change(stored)
    monkeypatch.setattr(io, "read_stored", lambda _: stored)
    with pytest.raises(pp.errors.FileError, match=f"damaged.*{name}"):
        pp.read_tissue(path)


def test_an_incision_is_everywhere_equally_deep():
    mesh = brick((4, 4, 4))
    block = pp.Tissue(mesh, 5.0, 0.45, mesh.nodes[:, 2] == 0)
    blade = pp.incision(block, [(21, 10, 50), (21, 40, 50)], depth=9)
    assert blade.points[:, 2].min() == pytest.approx(41)
    assert np.ptp(blade.points[:, 0]) < 1e-9
    lips = pp.cut(block, blade).mesh
    corners = lips.places[lips.skin.triangles[lips.skin.lip]]
    twice = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    assert twice / 4 == pytest.approx(9 * 30)


def test_an_incision_follows_a_round_surface(whole, top):
    path = [top - (20, 0, 0), top + (20, 0, 0)]
    blade = pp.incision(whole, path, depth=6, direction=(0, 0, -1))
    tips = blade.points[len(blade.points) // 2 :]
    height = [whole.surface.closest(tip).distance for tip in tips]
    assert np.ptp(tips[:, 2]) > 2  # the surface falls from the middle to the ends
    assert min(height) > 3
    assert max(height) < 6.5


@pytest.mark.parametrize(
    ("path", "depth", "direction", "said"),
    [
        ([(0, 0, 25)], 5, None, "two or more"),
        ([(-5, 0, 25), (5, 0, 25)], -5, None, "above 0"),
        ([(-5, 0, 25), (5, 0, 25)], 5, (0, 0, 0), "points nowhere"),
        ([(-5, 0, 25), (5, 0, 225)], 5, None, "mm off the surface"),
    ],
)
def test_an_incision_that_cannot_be(whole, path, depth, direction, said):
    with pytest.raises(pp.errors.DataError, match=said):
        pp.incision(whole, path, depth, direction)


def command(monkeypatch, folder, words):
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", ["palpate", "cut", *words.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code


def test_the_command_cuts_and_draws(whole, top, tmp_path, monkeypatch, capsys):
    pp.write_tissue(tmp_path / "tissue.vtu", whole)
    words = "tissue.vtu --from -15,0,22 --to 15,0,22 --depth 10 -o cut.vtu --picture cut.png"
    assert command(monkeypatch, tmp_path, words) == 0
    said = capsys.readouterr().out
    assert "copies of nodes, 1 piece of" in said
    assert (tmp_path / "cut.png").read_bytes()[:4] == b"\x89PNG"
    soft = pp.model(pp.read_tissue(tmp_path / "cut.vtu"), "compliance").push(top + (0, 7, 0), (0, 0, -1), 8).force[2]
    assert soft < pp.model(whole, "compliance").push(top + (0, 7, 0), (0, 0, -1), 8).force[2]
    assert command(monkeypatch, tmp_path, "cut.vtu --from 0,-12,22 --to 0,12,22 --depth 8 -o cross.vtu") == 0
    assert len(pp.read_tissue(tmp_path / "cross.vtu").mesh.blades) == 2


def test_the_command_refuses(whole, tmp_path, monkeypatch, capsys):
    pp.write_tissue(tmp_path / "tissue.vtu", whole)
    for words, said in {
        "tissue.vtu --from 1,2 --to 15,0,22 --depth 10 -o cut.vtu": "give three numbers",
        "tissue.vtu --from -15,0,22 --to 15,0,22 --depth 0 -o cut.vtu": "--depth: 0.0 mm",
        "tissue.vtu --from -160,0,15 --to 60,0,15 --depth 9 --direction 0,0,-1 -o cut.vtu": "off the surface",
        "tissue.vtu --from 0,-29,5 --to 0,29,5 --depth 99 --direction 0,0,-1 --loose drop -o cut.vtu": "--loose: 'drop'",
    }.items():
        assert command(monkeypatch, tmp_path, words) == 2
        assert said in capsys.readouterr().err
        assert not (tmp_path / "cut.vtu").exists()


@pytest.mark.parametrize("words", ["fit cut.vtu --young 5 -o t.vtu", "mesh cut.vtu -o m.msh"])
def test_commands_that_take_no_cut_tissue_say_so(opened, tmp_path, monkeypatch, capsys, words):
    pp.write_tissue(tmp_path / "cut.vtu", opened)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["palpate", *words.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "cut" in capsys.readouterr().err.removeprefix("palpate: cut.vtu")


def test_only_a_cut_is_drawn(whole):
    with pytest.raises(pp.errors.DataError, match="has not been cut"):
        pp.plot_cut(whole)
