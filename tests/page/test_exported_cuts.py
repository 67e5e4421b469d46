"""Cuts in an exported organ: its engine in Node against the native one, and a hand in a real Chromium, offline."""

import json

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from support.engine_in_node import run_in_node
from support.example_organs import organ
from support.exported_page import DEVICES, opened_offline

import palpate as pp
from palpate.errors import FileError
from palpate.simulation.page_record import parse_page_record
from palpate.simulation.session_compatibility import recorded_settings
from palpate.standalone.organ_data import organ_data, session_of

DEPTH = 16.0  # mm
AWAY = (0, 0, 0, 0, 0, 0, 0)


def across(tissue, offset=0.0):
    """A way over the top, at right angles to x, that no node lies on."""
    top = tissue.mesh.nodes[np.argmax(tissue.mesh.nodes[:, 2])] + (offset, 0, 0)
    return [tissue.surface.closest(top + (0, y, 0)).point for y in (-15.7, 0.23, 16.4)]


def hold(point, displacement, ticks):
    return [(1, *point, *displacement)] * ticks


def in_order(places, triangles, values):
    """Means of values (v, 3) over triangles, in the order of their middles at rest: that of the vertices may differ."""
    middle = places[triangles].mean(axis=1)
    return values[triangles].mean(axis=1)[np.lexsort(np.round(middle, 3).T)]


@pytest.mark.parametrize("push", [(2.5, 0.2, -1.0), (-2.0, 0.3, 1.5)], ids=["pressed shut", "pulled open"])
@pytest.mark.parametrize("size", [6, 8])
def test_forces_of_a_cut_body_are_those_of_the_native_engine(size, push, tmp_path):
    """A hand holds on while the organ is cut twice beside it and one cut is taken back."""
    tissue = organ(size)
    first, second = across(tissue, 0.37), pp.incision(tissue, across(tissue, -6.0), DEPTH / 2)
    beside = tissue.surface.closest(np.array(first[1]) - (5, 0, 0)).point
    given = [
        *hold(beside, push, 150),
        {"way": np.array(first).tolist(), "depth": DEPTH},
        *hold(beside, push, 500),
        {"blade": second.points[second.triangles].ravel().tolist()},
        *hold(beside, push, 500),
        None,
        *hold(beside, push, 500),
    ]
    found = run_in_node(tmp_path, session_of(tissue), given)

    native = session_of(tissue)
    command = pp.Command(True, tuple(beside), push, "hold")
    expected = [native.step([command] * 150)]
    native.cut(pp.incision(tissue, first, DEPTH))
    opened = native.displayed
    expected.append(native.step([command] * 500))
    native.cut(second)
    expected.append(native.step([command] * 500))
    native.undo()
    expected.append(native.step([command] * 500))
    forces = np.concatenate(expected)
    np.testing.assert_allclose(found["forces"], forces, atol=2e-5 * np.abs(forces).max())
    drawn = found["opened"][0]
    rest, triangles = np.reshape(drawn["rest"], (-1, 3)), np.reshape(drawn["triangles"], (-1, 3))
    there = opened.places, opened.triangles
    np.testing.assert_allclose(in_order(rest, triangles, rest), in_order(*there, opened.places), atol=1e-4)
    assert drawn["lips"] == list(opened.lips)
    shown = native.displayed.carried(native.loop.frame().shown)
    moved = in_order(rest, triangles, np.reshape(found["shown"], (-1, 3)))
    np.testing.assert_allclose(moved, in_order(*there, shown), atol=1e-4)


def test_a_blade_through_a_lump_is_felt_as_by_the_native_engine(tmp_path):
    tissue = organ(8)
    session, tough = session_of(tissue, toughness={"organ": 100, "lump": 900}), []
    for x in np.linspace(-15, 12, 200):
        tough.append((4, *tissue.surface.closest(np.array((x, 2.0, 25.0))).point, 1.0, 0.0, -18.0))
    found = run_in_node(tmp_path, session, tough)["forces"]
    expected = session.step([pp.Command(True, one[1:4], one[4:], "blade") for one in tough])
    size = np.linalg.norm(expected, axis=1)
    assert size.max() > 3 * np.median(size[20:60]), "it meets the lump"
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_bodies_made_by_another_engine_give_the_same_bits(tmp_path):
    """As the page's second worker makes them: a cut, the same one further, another one, and one taken back."""
    tissue = organ(6)
    way, beside = across(tissue, 0.37), tissue.surface.closest(np.array(across(tissue)[1]) - (5, 0, 0)).point
    whole, half = pp.incision(tissue, way, DEPTH), pp.incision(tissue, way[:2], DEPTH)
    other = pp.incision(tissue, across(tissue, -6.0), DEPTH / 2)
    cut, further, second = ({"blade": one.points[one.triangles].ravel().tolist()} for one in (half, whole, other))
    given = [*hold(beside, (-2.0, 0.3, 1.5), 100)]
    for change in (cut, further | {"further": True}, second, None):
        given += [change, *hold(beside, (-2.0, 0.3, 1.5), 150)]
    here, apart = (run_in_node(tmp_path, session_of(tissue), given, apart) for apart in (False, True))
    assert here["digest"] == apart["digest"]
    assert here["opened"] == apart["opened"]
    assert [len(one["rest"]) for one in here["opened"]] == sorted(len(one["rest"]) for one in here["opened"])

    native = session_of(tissue)
    command = pp.Command(True, tuple(beside), (-2.0, 0.3, 1.5), "hold")
    expected = [native.step([command] * 100)]
    for blade, extend in ((half, False), (whole, True), (other, False)):
        native.cut(blade, extend=extend)
        expected.append(native.step([command] * 150))
    native.undo()
    forces = np.concatenate([*expected, native.step([command] * 150)])
    np.testing.assert_allclose(apart["forces"], forces, atol=2e-5 * np.abs(forces).max())


def test_lips_pressed_together_press_on_each_other(tmp_path):
    """A hand that presses the cut shut feels what it felt before the cut, within what slides along it."""
    tissue = organ(8)
    way = across(tissue)
    beside = tissue.surface.closest(np.array(way[1]) - (5, 0, 0)).point
    push = {sign: (sign * 2.0, 0.0, 0.0) for sign in (1, -1)}
    cut = {"way": np.array(way).tolist(), "depth": DEPTH}
    lost = {}
    for sign, ways in push.items():
        forces = run_in_node(tmp_path, session_of(tissue), [*hold(beside, ways, 150), cut, *hold(beside, ways, 500)])[
            "forces"
        ]
        before, after = abs(forces[149][0]), abs(forces[-1][0])
        lost[sign] = 1 - after / before
    assert lost[1] < 0.5 * lost[-1]
    assert lost[-1] > 0.1


def test_a_cut_taken_back_returns_forces_to_the_bit(tmp_path):
    tissue = organ(8)
    point = np.array(across(tissue)[1])
    cut = {"way": np.array(across(tissue, 4.0)).tolist(), "depth": DEPTH}
    press = [*hold(point, (0, 0, -2), 400), *[AWAY] * 400]
    plain = run_in_node(tmp_path, session_of(tissue), [*press, *press])
    undone = run_in_node(tmp_path, session_of(tissue), [*press, cut, None, *press])
    assert undone["forces"] == plain["forces"]


def test_an_organ_that_was_cut_before_is_exported_and_cut_again(tmp_path):
    tissue = organ(8)
    opened = pp.cut(tissue, pp.incision(tissue, across(tissue, 0.37), DEPTH))
    second = pp.incision(tissue, across(tissue, -6.0), DEPTH / 2)
    beside = opened.surface.closest(np.array(across(tissue)[1]) - (5, 0, 0)).point
    pull = (-2.0, 0.3, 1.5)
    cut = {"blade": second.points[second.triangles].ravel().tolist()}
    found = run_in_node(tmp_path, session_of(opened), [*hold(beside, pull, 300), cut, *hold(beside, pull, 400), None])

    native = session_of(opened)
    command = pp.Command(True, tuple(beside), pull, "hold")
    expected = [native.step([command] * 300)]
    native.cut(second)
    expected.append(native.step([command] * 400))
    np.testing.assert_allclose(found["forces"], np.concatenate(expected), atol=2e-5 * np.abs(expected[0]).max())
    assert len(found["shown"]) == 3 * len(session_of(opened).displayed.places)  # the cut taken back is the second one
    whole = run_in_node(tmp_path, session_of(tissue), hold(beside, pull, 300))
    assert np.abs(np.array(whole["forces"][-1]) - found["forces"][299]).max() > 0.01


def test_a_cut_that_meets_nothing_changes_nothing(tmp_path):
    tissue = organ(8)
    top, point = tissue.mesh.nodes[:, 2].max(), np.array(across(tissue)[1])
    beside = pp.Blade.swept([(200, -20, top), (200, 20, top)], (0, 0, -1), 40)
    cut = {"blade": beside.points[beside.triangles].ravel().tolist()}
    press = hold(point, (0, 0, -2), 300)
    plain, tried = (run_in_node(tmp_path, session_of(tissue), [*press, *some, *press]) for some in ([], [cut]))
    assert ["met nothing" in words for words in tried["refused"]] == [True]
    assert tried["opened"] == []
    assert tried["forces"] == plain["forces"]


def test_what_comes_free_is_taken_away_as_in_a_session(tmp_path):
    """The top of the organ with most of its lump, and a hand beside it that stays; one on it holds nothing."""
    tissue = organ(8)
    top = tissue.mesh.nodes[:, 2].max()
    through = pp.Blade.swept([(-200, -200, top - 9), (200, -200, top - 9)], (0, 1, 0), 400)
    cut = {"blade": through.points[through.triangles].ravel().tolist()}
    side = tissue.surface.closest(np.array((60.0, 0.0, 0.0))).point
    push = (-1.5, 0.2, 0.3)
    found = run_in_node(tmp_path, session_of(tissue), [*hold(side, push, 200), cut, *hold(side, push, 500)])
    native = session_of(tissue)
    command = pp.Command(True, tuple(side), push, "hold")
    expected = [native.step([command] * 200)]
    native.cut(through)
    expected.append(native.step([command] * 500))
    np.testing.assert_allclose(found["forces"], np.concatenate(expected), atol=2e-5 * np.abs(expected[0]).max())
    drawn = found["opened"][0]
    assert drawn["taken"] == pytest.approx([native.taken["organ"], native.taken["lump"]], rel=1e-9)
    assert drawn["area"] == pytest.approx(native.cutting_work[-1].area, rel=1e-9)
    assert len(drawn["rest"]) == 3 * len(native.displayed.places)
    lost = run_in_node(
        tmp_path,
        session_of(tissue),
        [*hold(across(tissue)[1], (0, 0, 2), 200), cut, *hold(across(tissue)[1], (0, 0, 2), 100)],
    )
    assert not np.any(lost["forces"][202:])
    assert lost["contact"][0] == 2


def test_where_the_page_does_not_cut_it_offers_none(monkeypatch):
    """An organ too large for its memory; lips that rub."""

    def tools(tissue):
        data = organ_data(session_of(tissue), "organ")
        length = int.from_bytes(data[4:8], "little")
        return json.loads(data[8 : 8 + length])["tools"]

    assert "cut" in tools(organ(6))
    assert "cut" not in tools(organ(6).replace(surface_friction=0.2))
    monkeypatch.setattr("palpate.standalone.organ_data.MOST_NODES", 100)
    assert "cut" not in tools(organ(6))


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("exported") / "organ.html"
    return pp.export(organ(9), path, title="Training")


@pytest.fixture(params=DEVICES, ids=" ".join)
def opened(browser, page_file, request):
    with opened_offline(browser, page_file, *request.param) as page:
        yield page


def draw(touched, start, way, steps=20, half_way=None):
    """half_way: waits for this, while the hand holds the blade."""
    page = touched.page
    page.mouse.move(*start)
    page.mouse.down()
    for i in range(1, steps + 1):
        page.mouse.move(*(start + way * i / steps))
        page.wait_for_timeout(20)
        if half_way and i == steps // 2:
            touched.wait(half_way)
    page.mouse.up()


@pytest.mark.browser
def test_a_stroke_cuts_offline_and_the_lips_part_where_one_pulls(opened, album, tmp_path):
    page = opened.page
    (page.tap if opened.device == "phone" else page.click)("#cut-tool")
    assert opened.see("document.getElementById('undo-cut').disabled")
    start, way = opened.place(0.36, 0.42), np.array((110, 0)) if opened.device == "phone" else np.array((220, 0))
    draw(opened, start, way, half_way="palpate.scene.made === 1 && palpate.frame.contact[0] === 4")
    opened.until_told("Cut of")
    opened.wait("palpate.scene.made === 1 && palpate.frame.body === palpate.scene.body")
    assert opened.see("palpate.scene.lips[0] < palpate.scene.nodes")
    opened.wait("document.getElementById('about').textContent.includes('1 cut')")
    found = Axe().run(page)
    assert found.violations_count == 0, found.generate_report()
    if opened.device == "phone":
        page.screenshot(path=album / "exported-cut-phone.png")
        return
    page.keyboard.press("2")  # pull
    page.mouse.move(*(start + way / 2 + (0, 30)))
    page.mouse.down()
    page.mouse.move(*(start + way / 2 + (0, 120)), steps=20)
    opened.settle()
    force = opened.tool()[2]
    tick = int(opened.see("palpate.frame.tick"))
    page.screenshot(path=album / "exported-cut.png")
    page.mouse.up()
    opened.until_home()
    page.keyboard.press("z")
    opened.wait("palpate.scene.made === 0 && palpate.frame.body === palpate.scene.body")
    with page.expect_download() as saved:
        page.locator("#save-session").click()
    saved.value.save_as(tmp_path / "session.json")
    text = json.loads((tmp_path / "session.json").read_text())
    kinds = [one[1] for one in text["cuts"]]
    assert (kinds[0], kinds[-1]) == ("cut", "undo")
    assert set(kinds[1:-1]) == {"extend"}
    assert np.diff([one[0] for one in text["cuts"]]).min() > 0  # ticks ran while the next body was made
    record = pp.read_record(tmp_path / "session.json")
    assert run_in_node(tmp_path, session_of(organ(9)), text) == text["digests"]
    session = pp.Session(pp.model(organ(9), "compliance"), **recorded_settings(record))
    replayed = np.concatenate([some for _, some in session.replayed(record, 1000)])
    assert np.linalg.norm(force) > 0.05
    assert np.abs(replayed[tick - 1, 0] - force).max() <= 1e-3  # another instruction set: a millinewton
    assert session.cuts == 0


@pytest.mark.browser
def test_a_stroke_from_edge_to_edge_frees_a_piece(opened, album):
    """The hand begins at the organ's edge and goes past the other one: the cut goes all the way through."""
    page = opened.page
    if opened.device == "phone":
        return
    page.click("#cut-tool")
    page.locator("#amount").fill(str(opened.see("document.getElementById('amount').max")))
    assert opened.see("document.getElementById('amount-set').textContent") == "through"
    start, end = (np.array(opened.see(f"palpate.pixel({point})")) for point in ([34, 2, 12.5], [34, -5, -11.5]))
    draw(opened, start, 1.9 * (end - start), 60)
    opened.until_told("came free")
    opened.wait("palpate.scene.made === 1 && palpate.frame.body === palpate.scene.body")
    page.screenshot(path=album / "exported-piece-taken.png")
    page.keyboard.press("z")
    opened.wait("palpate.scene.made === 0")


@pytest.mark.browser
def test_a_fast_hand_cuts_up_to_the_edge_as_a_slow_one(opened):
    """The page may see no point of a stroke between the organ's middle and one far outside."""
    page = opened.page
    if opened.device == "phone":
        return
    page.click("#cut-tool")
    start, way = opened.place(0.36, 0.42), np.array((700, 0))
    areas = []
    for points in (np.linspace(0, 1, 61)[1:], [0.1, 1.0]):
        page.mouse.move(*start)
        page.mouse.down()
        for part in points:
            page.mouse.move(*(start + part * way))
            page.wait_for_timeout(20)
        page.mouse.up()
        opened.until_told("Cut of")
        areas.append(float(opened.see("hints.find((hint) => hint.startsWith('Cut of'))").split()[2]))
        page.keyboard.press("z")
        opened.wait("palpate.scene.made === 0")
        opened.see("hints.length = 0")
    assert areas[1] == pytest.approx(areas[0], rel=0.1)


@pytest.mark.parametrize(
    "cuts", [[[5, "cut"]], [[5, "saw", [], []]], [["a", "undo"]], [[1, "cut", [[0, 0, 0]], [[0, 0, 0]]]], 3]
)
def test_cuts_that_no_page_saved_are_refused(cuts):
    saved = {
        "format": "palpate page session",
        "version": 1,
        "length": 10,
        "commands": [],
        "digests": [],
        "switches": [],
    }
    saved |= {"model": "compliance", "tissue": "", "settings": {}, "instructions": "", "marks": [], "cuts": cuts}
    with pytest.raises(FileError, match="no session that a page saved"):
        parse_page_record(json.dumps(saved).encode(), "session.json")
