"""Geometry from balls at known places, against exact geometry, closed forms, and what the reported deviations promise."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from PIL import Image
from support.ball_phantoms import ball_case, direction, displaced, errors, tilted
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.errors import DataError, FileError, GeometryError
from palpate.scans.ball_matching import assign
from palpate.scans.ball_shadows import centres
from palpate.scans.view_fit import fit_views
from palpate.scans.view_parameters import PARAMETERS, poses, views_of

SIZE = 0.02  # pixels, of planted errors of shadows


def cloud(seed=5, count=18):
    return np.random.default_rng(seed).uniform((-45, -45, 15), (45, 45, 65), (count, 3))


def arc(off=0.0):
    panel = pp.Panel((300, 300), (0.5, 0.5), (-74.75, -74.75, 0))
    return pp.arc_views(
        panel, np.linspace(-20 - 2 * off, 20 + 2 * off, 9), radius=600 * (1 + 0.02 * off), pivot=(0, 0, 40)
    )


def orbit(off=0.0):
    return pp.orbit_views(
        (300, 300),
        (1.0, 1.0),
        source_to_centre=600 * (1 + 0.02 * off),
        source_to_panel=1000 * (1 - 0.02 * off),
        count=9,
        arc=150 + 4 * off,
        start=-2 * off,
        axis=(0, 1, 0),
        centre=(0, 0, 40),
    )


def wrong(views, seed=3):
    """The start: panels tilted by 1 degree more, and everything 3 mm and 1 degree from where the balls are."""
    rng = np.random.default_rng(seed)
    return displaced(tilted(views, direction(rng)), direction(rng), 3 * direction(rng), np.array([0, 0, 40.0]))


KINDS = {
    "each view": (orbit, dict(still_panel=False)),
    "still panel": (arc, dict(still_panel=True)),
    "rotation with its panel": (orbit, dict(rigid=True)),
    "rotation above a still panel": (arc, dict(rigid=True)),
}


def some_views(case, which):
    return replace(case, views=case.views[which], start=case.start[which])


@pytest.mark.parametrize("kind", KINDS)
def test_exact_shadows_give_the_exact_geometry(kind):
    make, how = KINDS[kind]
    balls, true, start = cloud(), make(), wrong(make(1.0))
    seen = true.project(balls)
    assert max(errors(start, true, balls).values()) > 1
    fit = fit_views(poses(start), balls, seen, np.full(seen.shape, SIZE), **how)
    assert fit.used.all()
    assert fit.undetermined == ()
    found = views_of(fit.at, start)
    assert np.abs(found.source - true.source).max() < 1e-5
    assert np.abs(found.project(balls) - seen).max() < 1e-6
    assert max(errors(found, true, balls).values()) < 1e-5


@pytest.mark.parametrize("kind", KINDS)
def test_errors_are_as_large_as_the_standard_deviations_say(kind):
    make, how = KINDS[kind]
    balls, true = cloud(), make()[::2]
    rng, sums, draws = np.random.default_rng(8), [], 16
    exact = true.project(balls)
    for _ in range(draws):
        seen = exact + SIZE * rng.standard_normal(exact.shape)
        fit = fit_views(poses(true), balls, seen, np.full(exact.shape, 1.0), **how)  # the residual must tell the size
        sums.append((fit.changes / fit.deviations) ** 2)
    # Each is the square of Student's t; the start is the truth. Their mean over parameters and draws is near 1.
    freedom = 2 * len(balls) - 9 if kind == "each view" else 2 * len(balls) * len(true) - len(fit.changes)
    expected = freedom / (freedom - 2)
    means = np.mean(sums, axis=1)
    assert abs(means.mean() - expected) < 4 * means.std() / np.sqrt(draws)
    assert means.std() / np.sqrt(draws) < 0.2 * expected


def test_half_the_noise_is_half_the_error():
    balls, true = cloud(), orbit()
    noise = np.random.default_rng(2).standard_normal((9, len(balls), 2))
    changes = []
    for size in (0.02, 0.01):
        seen = true.project(balls) + size * noise
        changes.append(fit_views(poses(true), balls, seen, np.full(seen.shape, size), still_panel=False).changes)
    assert np.abs(changes[0]).max() > 0.05
    assert np.allclose(changes[0], 2 * changes[1], atol=0.02 * np.abs(changes[0]).max())


def test_balls_in_a_plane_leave_the_closed_form_undetermined():
    # Balls in a plane d below the source and e above the panel throw shadows that are (d + e)/d times as large. Any move
    # of the source by s and of the panel by -s·e/d, along the axis or across it, leaves every shadow where it was.
    balls = cloud()
    balls[:, 2] = 40.0
    views, d, e = arc()[[4]], 600.0, 40.0
    start = pp.Views(views.source + (2, -3, 6), views.panels[0])
    seen = views.project(balls)
    fit = fit_views(poses(start), balls, seen, np.full(seen.shape, SIZE), still_panel=False)
    assert len(fit.undetermined) == 3
    assert all(words.startswith("the balls lie in one plane: view 0: ") for words in fit.undetermined)
    for number in range(3):
        (words,) = [w for w in fit.undetermined if PARAMETERS[number] in w and PARAMETERS[number + 3] in w]
        sizes = [float(part.split()[0]) for part in words.split(" by ")[1:]]
        assert min(map(abs, sizes)) / max(map(abs, sizes)) == pytest.approx(e / d, abs=0.005)
    assert np.isinf(fit.deviations[:3]).all()
    assert np.isfinite(fit.deviations[6:]).all()
    # What is not told is as it was in the start, and the shadows are explained all the same.
    assert np.abs(fit.at.source - start.source).max() < 0.3
    assert np.abs(fit.residuals).max() < 1e-3


def test_depth_makes_it_determined_again():
    balls, views = cloud(), arc()[[4]]
    seen = views.project(balls)
    fit = fit_views(poses(views), balls, seen, np.full(seen.shape, SIZE), still_panel=False)
    assert fit.undetermined == ()
    assert np.isfinite(fit.deviations).all()


def test_the_answer_is_the_shadow_of_the_centre_not_the_centre_of_the_shadow():
    # A large ball far off axis and near the source: its shadow is an ellipse whose centre is displaced outwards.
    panel = pp.Panel((260, 400), (0.5, 0.5), (-40, -64.75, 0))
    views, ball, radius = pp.Views([(0, 0, 300)], panel), np.array([[48.0, 0, 150]]), np.array([6.0])
    scan = pp.simulate_scan(pp.Phantom([(pp.Ellipsoid(ball[0], 6.0), 0.05)]), views, 1e5, None, subrays=4)
    p, true = pp.line_integrals(scan)[0].astype(float), views.project(ball)[0]
    rows, columns = np.indices(p.shape)
    gravity = np.array([(rows * p).sum(), (columns * p).sum()]) / p.sum()
    assert np.hypot(*(gravity - true[0])) > 0.2
    arrays = (scan.counts[0], scan.incident[0], scan.background[0], scan.mask[0])
    found = centres(*arrays, poses(views), 0, ball, radius, true, true + (1.5, -2))
    assert found.found.all()
    assert np.abs(found.centres - true).max() < 0.005


def test_centres_scatter_as_their_deviations_say():
    case = some_views(ball_case(1, "arc", 0.6), [7])
    true, scores = case.views.project(case.balls)[0], []
    for seed in range(25):
        scan = case.scan(2000, seed)
        arrays = (scan.counts[0], scan.incident[0], scan.background[0], scan.mask[0])
        radii = np.full(len(case.balls), case.diameter / 2)
        found = centres(*arrays, poses(case.views), 0, case.balls, radii, true, true)
        assert found.found.sum() >= 10
        scores.append((((found.centres - true) / found.deviations)[found.found] ** 2).mean())
        assert np.abs(found.centres - true)[found.found].max() < 0.15
    assert 0.8 < np.mean(scores) < 1.3


@pytest.mark.parametrize(("motion", "seed"), [("arc", 4), ("orbit", 11)])
def test_from_counts_to_the_geometry(motion, seed):
    case = some_views(ball_case(seed, motion, 1.0), slice(None, None, 2))
    scan = case.scan(2000, seed)
    found = pp.calibrate_from_balls(scan, case.balls, diameter=case.diameter, rigid=True)
    before, after = errors(case.start, case.views, case.balls), errors(found.views, case.views, case.balls)
    assert min(before["arc"], before["source to panel"]) > 1
    assert max(after["tilt"], after["turn"]) < 0.1
    assert max(after["arc"], after["source to balls"], after["source to panel"]) < 0.2
    used = np.isfinite(found.residuals).all(axis=2)
    assert 0.7 < np.sqrt(np.mean(found.residuals[used] ** 2) / np.mean(found.noise[used] ** 2)) < 1.5


@pytest.fixture(scope="module")
def case():
    """With few views, to be quick."""
    return some_views(ball_case(6, "arc", 1.0), slice(None, None, 3))


@pytest.fixture(scope="module")
def seen(case):
    return case.scan(2000, 6)


def test_a_table_of_another_phantom_is_refused(case, seen):
    for seed in range(4):
        other = np.random.default_rng(seed).uniform(*case.block, case.balls.shape)
        with pytest.raises(DataError, match=r"view \d+: "):
            pp.calibrate_from_balls(seen, other, diameter=case.diameter)


def test_a_lattice_is_not_taken_for_itself_one_period_away(case):
    line = np.arange(-40, 41, 20.0)
    lattice = np.array([(x, y, z) for x in line for y in line for z in (15, 65)])
    scan = replace(case, balls=lattice).scan(2000, 2)
    found = pp.calibrate_from_balls(scan, lattice, diameter=case.diameter)
    assert max(errors(found.views, case.views, lattice).values()) < 0.4
    off = displaced(case.start, (0, 0, 0), (20.0, 0, 0), np.zeros(3))
    try:
        found = pp.calibrate_from_balls(scan, lattice, off, diameter=case.diameter)
    except DataError:
        return
    assert max(errors(found.views, case.views, lattice).values()) < 0.4


def test_balls_that_are_elsewhere_are_left_out_or_the_table_is_refused(case, seen):
    rng, refused = np.random.default_rng(1), []
    for share in (0.1, 0.3, 0.6):
        table = case.balls.copy()
        moved = rng.permutation(len(table))[: round(share * len(table))]
        table[moved] += 4 * np.array([direction(rng) for _ in moved])
        try:
            found = pp.calibrate_from_balls(seen, table, diameter=case.diameter)
        except DataError:
            refused.append(share)
            continue
        assert max(errors(found.views, case.views, case.balls).values()) < 0.4
    assert 0.1 not in refused
    assert 0.6 in refused


def test_a_start_that_is_far_off_is_refused_or_mended(case, seen):
    far = displaced(case.start, (0, 0, 90), (0, 0, 0), case.balls.mean(axis=0))
    with pytest.raises(DataError, match=r"view \d+: "):
        pp.calibrate_from_balls(seen, case.balls, far, diameter=case.diameter)


def test_a_tube_that_wobbles_is_no_rotation(case):
    rng = np.random.default_rng(9)
    wobbling = pp.Views(case.views.source + rng.normal(0, 3, case.views.source.shape), case.views.panels)
    scan = replace(case, views=wobbling).scan(2000, 1)
    found = pp.calibrate_from_balls(scan, case.balls, diameter=case.diameter)
    assert max(errors(found.views, wobbling, case.balls).values()) < 0.5
    with pytest.raises(DataError, match="or fit without rigid"):
        pp.calibrate_from_balls(scan, case.balls, diameter=case.diameter, rigid=True)


def test_spots_are_assigned_though_some_are_missing_and_some_are_no_balls():
    for seed in range(30):
        rng = np.random.default_rng(seed)
        balls = rng.uniform((-45, -45, 10), (45, 45, 70), (20, 3))
        true, start = arc()[[3]], wrong(arc(1.0), seed)[[3]]
        seen = true.project(balls)[0] * 0.5
        order = rng.permutation(20)[:16]
        spots = np.concatenate([seen[order] + rng.normal(0, 0.2, (16, 2)), rng.uniform(0, 150, (6, 2))])
        chosen = assign(start.project(balls)[0] * 0.5, balls, spots, 30.0, 3.0)
        right = {ball: spot for spot, ball in enumerate(order)}
        agree = [chosen[ball] == spot for ball, spot in right.items()]
        assert np.mean(agree) > 0.85, seed


def test_what_cannot_calibrate_is_refused(case, seen):
    balls, diameter = case.balls, case.diameter
    line = np.linspace((-40, 0, 20), (40, 0, 60), 12)
    bad = balls.copy()
    bad[2, 1] = np.nan
    twice = balls.copy()
    twice[3] = twice[5]
    refused = [
        (dict(balls=balls[:5], diameter=3), "5 given, at least 6"),
        (dict(balls=balls), "diameter: not given"),
        (dict(balls=balls, diameter=0), "expected mm above 0"),
        (dict(balls=line, diameter=2), "one line"),
        (dict(balls=bad, diameter=3), "not finite"),
        (dict(balls=twice, diameter=3), "3 and 5 are 0 mm apart"),
        (dict(balls=balls[:, :2], diameter=3), "got 2 columns"),
        (dict(balls=balls, diameter=diameter, views=case.start[:3]), "the start has"),
    ]
    for words, message in refused:
        with pytest.raises(DataError, match=message):
            pp.calibrate_from_balls(seen, **words)
    beam = pp.parallel_views(seen.shape[1:], (1, 1), centre_to_panel=100, count=len(seen.views))
    with pytest.raises(GeometryError, match="parallel beam"):
        pp.calibrate_from_balls(seen, balls, beam, diameter=3)
    line_of_spots = pp.Views(np.linspace((-200, 0, 600), (200, 0, 600), len(seen.views)), case.start.panels[0])
    with pytest.raises(GeometryError, match="on a line"):
        pp.calibrate_from_balls(seen, balls, line_of_spots, diameter=diameter, rigid=True)
    with pytest.raises(GeometryError, match="panels that differ"):
        fit_views(poses(orbit()), cloud(), orbit().project(cloud()), np.ones((9, 18, 2)), still_panel=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("x,y,z\n", "holds no ball"),
        ("x,y\n1,2\n", "column 'z' is missing"),
        ("1,2,3\n4,5,6\n", "column 'x' is missing"),
        ("x,y,z\n1,2,3\n4,,6\n", "line 3: y is no number: ''"),
        ("x,y,z\n1,2,3\n4,nan,6\n", "line 3: y is nan"),
        ("x,y,z\n1,2,3\n4,5\n", "line 3: z is no number"),
        ("x,y,z\n1,2,3e9\n", "line 2: z is 3e9"),
        ("x,y,z,diameter\n1,2,3,0\n", "diameter is 0"),
        ("x,y,z,x\n1,2,3,0\n", "'x' is there 2 times"),
    ],
)
def test_a_bad_table_is_refused_by_line_and_name(text, message, tmp_path):
    (tmp_path / "balls.csv").write_text(text)
    with pytest.raises(FileError, match=message) as refused:
        pp.read_balls(tmp_path / "balls.csv")
    assert "balls.csv" in str(refused.value)


def test_a_table_with_comments_and_other_columns_is_read(tmp_path):
    (tmp_path / "balls.csv").write_text("# mm\nname, Z ,x,y\n\na,3,1,2\nb,6.5,4,5\n")
    assert pp.read_balls(tmp_path / "balls.csv").tolist() == [[1, 2, 3], [4, 5, 6.5]]


@pytest.mark.parametrize("make", [arc, orbit], ids=["still panel", "moving panel"])
def test_a_geometry_file_brings_the_views_back(make, tmp_path):
    views = tilted(make(), (1, 2, 3))
    pp.write_geometry(tmp_path / "g.yaml", views)
    again = pp.read_geometry(tmp_path / "g.yaml").views
    points = cloud()
    assert np.abs(again.project(points) - views.project(points)).max() < 1e-6
    assert np.allclose(again.source, views.source)


def test_a_geometry_file_keeps_the_lines_of_another(tmp_path):
    (tmp_path / "old.yaml").write_text(
        "units: cm\nvalues: intensity\nincident: 900\nbeam: {kv: 30, gap: 2}\nstack: {axes: [row, column, view]}\n"
        "panel: {shape: [40, 48], pitch: [0.2, 0.2], centre: [0, 0, 0]}\n"
        "views: {motion: arc, angles: [-5, 0, 5], radius: 60}\n"
    )
    old = pp.read_geometry(tmp_path / "old.yaml")
    pp.write_geometry(tmp_path / "new.yaml", old.views, tmp_path / "old.yaml")
    new = pp.read_geometry(tmp_path / "new.yaml")
    assert (new.values, new.incident, new.stack, new.beam) == (old.values, old.incident, old.stack, old.beam)
    assert np.allclose(new.views.source, old.views.source)


def test_the_command_makes_a_geometry_file_and_a_picture(case, seen, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pp.write_scan("balls.h5", seen)
    table = np.column_stack([case.balls, np.full(len(case.balls), case.diameter)])
    np.savetxt("balls.csv", table, delimiter=",", header="x,y,z,diameter", comments="")
    words = ["scan", "calibrate", "balls.h5", "--balls", "balls.csv", "-o", "g.yaml", "--plot", "g.png"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    found = pp.read_geometry("g.yaml").views
    assert max(errors(found, case.views, case.balls).values()) < 0.4
    assert "panel towards the source: " in done.output
    assert "pixels RMS left" in done.output
    picture = np.asarray(Image.open("g.png").convert("L"))
    assert picture.std() > 20
    assert yaml.safe_load((tmp_path / "g.yaml").read_text())["units"] == "mm"


def test_a_refused_command_touches_nothing(case, seen, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pp.write_scan("balls.h5", seen)
    (tmp_path / "g.yaml").write_text("an older result")
    np.savetxt("few.csv", case.balls[:4], delimiter=",", header="x,y,z", comments="")
    for words in (
        ["--balls", "few.csv", "--diameter", "3"],
        ["--balls", "none.csv"],
        ["--balls", "few.csv", "--plot", "g.txt"],
    ):
        done = CliRunner().invoke(app, ["scan", "calibrate", "balls.h5", "-o", "g.yaml", *words])
        assert done.exit_code != 0
        assert (tmp_path / "g.yaml").read_text() == "an older result"
        assert not (tmp_path / "g.txt").exists()
