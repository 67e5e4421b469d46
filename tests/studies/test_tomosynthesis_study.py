"""`palpate study tomosynthesis --quick`: its numbers computed again by other means, from the files that it leaves."""

import csv
import html
import json
import re

import nibabel as nib
import numpy as np
import pytest
from support.running_server import ended, interrupted, start

import palpate as pp
from palpate.errors import FileError
from palpate.report.stages import Stages
from palpate.studies.tomosynthesis.config import QUICK
from palpate.studies.tomosynthesis.ghost_shape import ghost_shape
from palpate.studies.tomosynthesis.image_quality import ImageQuality
from palpate.studies.tomosynthesis.run_store import run_all

pytestmark = pytest.mark.slow
SEEDS = range(QUICK.seeds)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    code, out, err = ended("study tomosynthesis --quick -o study --docs docs", folder)
    assert code == 0, err
    assert str(folder / "study" / "report.html") in out
    return folder / "study"


@pytest.fixture(scope="module")
def report(study):
    """The report's words."""
    return html.unescape(re.sub("<[^>]+>", " ", (study / "report.html").read_text()))


def table(study, name, **wanted):
    """Rows of a table with these values."""
    with (study / "tables" / f"{name}.csv").open(newline="") as file:
        return [r for r in csv.DictReader(file) if all(r[k] == str(v) for k, v in wanted.items())]


def run(study, *parts):
    return json.loads((study / "runs" / f"circular-{'-'.join(map(str, parts))}.json").read_text())


def values(path):
    """(z, y, x) of a file, by an independent reader; NIfTI's first two axes run against ours."""
    return np.asarray(nib.load(path).dataobj, np.float64).T


def test_every_figure_is_in_the_report_and_says_its_command(study, report):
    pictures = sorted((study / "figures").glob("*.png"))
    text = (study / "report.html").read_text()
    captions = re.findall("<figcaption>(.*?)</figcaption>", text)
    assert len(pictures) == len(captions) == text.count("data:image/png;base64") >= 20
    assert all(caption.endswith("Made by: palpate study tomosynthesis --quick") for caption in captions)
    for word in (
        "F-MAP",
        "M-MAP-2",
        "M-MAP-3",
        "z = 48 mm",
        "artefact spread",
        "sart",
        "hyperbola",
        "Local tomosynthesis",
        "trispiral",
        "Strength of the prior",
    ):
        assert word in report
    page = study.parent / "docs" / "tomosynthesis.md"
    links = re.findall(r"\]\((images/[^)]+)\)", page.read_text())
    assert len(links) == len(pictures)
    assert sum((page.parent / link).stat().st_size for link in links) < 3e6
    assert all((page.parent / link).stat().st_size > 1000 for link in links)


def test_errors_are_those_of_the_stored_volumes(study):
    truth, image_quality = values(study / "volumes" / "truth.nii.gz"), ImageQuality(QUICK)
    t = truth[image_quality.region]
    for method in ("f-map-descent-uniform", "m-map-3-momentum-backprojection"):
        for dose in QUICK.doses:
            f = values(study / "volumes" / f"circular-convergence-{dose}-0-{method}.nii.gz")
            name, optimiser, begin = method.rsplit("-", 2)
            (row,) = table(
                study, "convergence", dose=dose, seed=0, method=name.upper(), optimiser=optimiser, start=begin
            )
            assert float(row["nmse"]) == pytest.approx(((f - truth) ** 2).sum() / (truth**2).sum(), rel=1e-5)
            design = np.stack([f[image_quality.region], np.ones(t.size)], axis=1)
            rest = np.linalg.lstsq(design, t)[1][0]  # what window and level leave
            assert float(row["nmse_region"]) == pytest.approx(rest / ((t - t.mean()) ** 2).sum(), rel=1e-5)
            record = run(study, "convergence", dose, 0, *method.rsplit("-", 2))
            trace = record["trace"]
            assert trace["nmse"][record["stop"]] == pytest.approx(float(row["nmse"]), rel=1e-5)  # judged on its way
            assert trace["nmse_region"][record["stop"]] == pytest.approx(float(row["nmse_region"]), rel=1e-5)


def test_the_posterior_never_rises_within_a_level_and_is_that_of_the_stored_volume(study):
    paths = sorted((study / "runs").glob("*-convergence-*.json"))
    assert len(paths) == len(QUICK.doses) * (11 * QUICK.few + 8 * (QUICK.seeds - QUICK.few))
    for path in paths:
        record = json.loads(path.read_text())
        trace = {name: np.array(column) for name, column in record["trace"].items()}
        assert (np.diff(trace["level"]) <= 0).all()
        assert (np.diff(trace["cpu"]) > 0).all()
        for level in np.unique(trace["level"]):
            objective = trace["objective"][trace["level"] == level]
            assert (np.diff(objective) <= 1e-6 * objective[:-1]).all()
    dose = QUICK.doses[0]
    scan = QUICK.scan(np.load(study / "runs" / "passed-circular.npy"), "circular", dose, 0)
    f = values(study / "volumes" / f"circular-convergence-{dose}-0-m-map-3-momentum-uniform.nii.gz")
    record = run(study, "convergence", dose, 0, "m-map-3", "momentum", "uniform")
    mean = dose * np.exp(-pp.Projector(scan.views, QUICK.grid)(f.astype(np.float32)).astype(float))
    y = scan.counts.astype(float)
    deviance = (mean - y + y * np.log(np.maximum(y, 1e-9) / mean)).sum()
    assert 0 < deviance < record["trace"]["posterior"][record["stop"]] < 3 * deviance  # the prior makes up the rest


def test_pairs_follow_from_the_traces_and_stand_in_the_report(study, report):
    name = "M-MAP-3, descent, uniform start"
    for dose in QUICK.doses:
        works, errors = [], []
        for seed in SEEDS:
            f = run(study, "convergence", dose, seed, "f-map", "descent", "uniform")["trace"]
            m = run(study, "convergence", dose, seed, "m-map-3", "descent", "uniform")
            stop, t = m["stop"], m["trace"]
            there = [c for c, p in zip(f["passes"], f["posterior"], strict=True) if p <= t["posterior"][stop]]
            works.append((there or f["passes"][-1:])[0] / t["passes"][stop])
            spent = [e for e, c in zip(f["nmse"], f["passes"], strict=True) if c <= t["passes"][stop]]
            errors.append(spent[-1] / m["quality"]["nmse"])
            (row,) = table(study, "pairs", pair=name, dose=dose, seed=seed)
            assert float(row["passes"]) == pytest.approx(works[-1], rel=1e-6)
            assert float(row["equal_nmse"]) == pytest.approx(errors[-1], rel=1e-6)
        for ratios in (works, errors):
            assert f"{np.prod(ratios) ** (1 / len(ratios)):.3f} ({min(ratios):.3f} to {max(ratios):.3f})" in report


def test_passes_are_voxels_updated_over_those_of_the_finest_grid(study):
    """Each level has an eighth of the voxels of the one above, and a whole number of iterations before the next begins."""
    for seed in SEEDS:
        for begin in ("uniform", "backprojection"):
            record = run(study, "convergence", QUICK.doses[0], seed, "m-map-3", "descent", begin)
            trace = {name: np.array(column) for name, column in record["trace"].items()}
            most = {
                k: trace["iteration"][: record["stop"] + 1][trace["level"][: record["stop"] + 1] == k].max()
                for k in range(3)
            }
            expected = sum(count / 8**k for k, count in most.items())
            assert trace["passes"][record["stop"]] == pytest.approx(expected, rel=1e-12)
            assert (np.diff(trace["passes"]) > 0).all()
            (row,) = table(
                study, "convergence", dose=QUICK.doses[0], seed=seed, method="M-MAP-3", optimiser="descent", start=begin
            )
            assert [int(row[f"iterations_level_{k}"]) for k in range(3)] == [most[k] for k in range(3)]
    plain = run(study, "subsets", QUICK.doses[0], 0, "1", "plain")["trace"]
    assert plain["passes"] == plain["iteration"]  # without subsets and momentum no pass is made again
    for count in (2, 4, 8):
        again = run(study, "subsets", QUICK.doses[0], 0, str(count), "with_momentum")["trace"]
        assert (np.array(again["passes"]) >= again["iteration"]).all()
        assert np.array(again["passes"]) == pytest.approx(np.round(again["passes"]), abs=1e-9)


def test_the_verdict_by_the_full_field_is_that_of_the_stored_volumes(study, report):
    """On one scan; the claim's numbers are least and most of the two, one of which this is."""
    truth = values(study / "volumes" / "truth.nii.gz")
    for dose in QUICK.doses:
        back, multi = (
            values(study / "volumes" / f"circular-{name}.nii.gz")
            for name in (f"direct-{dose}-0-backprojection", f"convergence-{dose}-0-m-map-3-descent-uniform")
        )
        ratio = ((back - truth) ** 2).sum() / ((multi - truth) ** 2).sum()
        said = re.search(
            r"better images than backprojection; tried by NMSE of the full field, descent from a uniform start, on 2 scans a "
            rf"dose, this (.*?): .*?{dose // 1000}k [\d.]+ \(([\d.]+) to ([\d.]+)\)",
            report,
        )
        assert f"{ratio:.3f}" in said.groups()[1:]
        assert said[1].startswith("holds" if ratio > 1.02 else "does not hold (the opposite")


def test_what_a_ball_leaves_below_is_where_its_rays_go(study):
    """Blobs where the rays through the ball at z = 70 mm meet the slice at 38 mm: a ring and a streak, and a plain blob."""
    image_quality, ball = ImageQuality(QUICK), np.array([-34.0, -4.0, 70.0])
    x, y, z = (QUICK.grid.axis(name) for name in "xyz")
    k = int(np.argmin(np.abs(z - 38)))

    def ghosts(points):
        volume = np.zeros(QUICK.grid.shape)
        for at in points:
            volume[k] += np.exp(-((x - at[0]) ** 2 + (y[:, None] - at[1]) ** 2) / (2 * 2.5**2))
        return ghost_shape(volume, image_quality)

    def met(motion):
        return [s + (ball - s) * (s[2] - z[k]) / (s[2] - ball[2]) for s in QUICK.views(motion).source]

    ring, streak = ghosts(met("circular")), ghosts(met("linear"))
    assert ring["ring"] > 5
    assert streak["ring"] < 1
    assert ring["streak"] == pytest.approx(1, abs=0.2)
    assert streak["streak"] > 4
    blob = ghosts([np.mean(met("circular"), axis=0)])
    assert blob["ring"] < 0.2
    assert blob["streak"] == pytest.approx(1, abs=0.2)


def test_the_local_region_is_that_part_of_the_full_volume(study):
    full = values(study / "volumes" / "circular-local-20000-0-full.nii.gz")
    whole = pp.reconstruct(
        QUICK.scan(np.load(study / "runs" / "passed-circular.npy"), "circular", 20_000, 0), QUICK.grid
    )
    grid = pp.read_volume(study / "volumes" / "circular-local-20000-0-full.nii.gz").grid
    first = [int(np.argmin(np.abs(whole.grid.axis(a) - grid.axis(a)[0]))) for a in "zyx"]
    part = whole.values[tuple(slice(i, i + n) for i, n in zip(first, full.shape, strict=True))]
    np.testing.assert_allclose(full, part, atol=1e-6)
    errors = {row["method"]: float(row["nmse"]) for row in table(study, "local")}
    assert errors["full"] < errors["alone"]
    assert errors["local"] < errors["alone"]


def test_means_in_the_report_are_those_of_the_tables(study, report):
    for motion in ("circular", "linear", "hypocycloidal"):
        rows = table(study, "motions", method="backprojection", motion=motion)
        assert len(rows) == QUICK.seeds
        errors = [float(row["nmse_region"]) for row in rows]
        assert f"{motion} {np.mean(errors):.3f} ({min(errors):.3f} to {max(errors):.3f})" in report
    assert not re.search(r"\d ± \d", report)  # of two seeds no deviation is told


def test_the_scan_is_the_phantoms_own_shadow(study):
    """Where a ray meets the slab alone it passes exp(-0.02 · 44 mm / cosine); the panel's pixels average that."""
    passed, views = np.load(study / "runs" / "passed-circular.npy"), QUICK.views("circular")
    panel, source = (
        views.panels[0],
        views.source[0],
    )  # at x = +250: its rays through the slab's -x, -y corner see no insert
    pixel = np.round(views.project([(-45.0, -45.0, 54.0)])[0, 0]).astype(int)
    ray = source - panel.points(pixel)[0]
    expected = np.exp(-0.02 * 44 * np.linalg.norm(ray) / ray[2])
    assert passed[0, pixel[0], pixel[1]] == pytest.approx(expected, rel=1e-3)


def test_resuming_makes_only_what_is_missing(study):
    paths = sorted((study / "runs").glob("*.json"))
    before = {path: path.stat().st_mtime_ns for path in paths}
    lost = study / "runs" / f"circular-priors-{QUICK.doses[0]}-0-huber.json"
    kept = json.loads(lost.read_text())
    lost.unlink()
    records, _ = run_all(Stages(study, resume=True), QUICK, lambda what, share: None)
    assert len(records) == len(paths)
    assert {path for path in paths if path.stat().st_mtime_ns != before[path]} == {lost}
    assert json.loads(lost.read_text())["quality"] == pytest.approx(kept["quality"], rel=1e-6)


def test_another_study_is_not_mixed_in(study):
    with pytest.raises(FileError, match="--quick"):
        pp.tomosynthesis_study(study, resume=True)


def test_ctrl_c_keeps_what_is_done_and_says_how_to_go_on(tmp_path):
    process = start("study tomosynthesis --quick -o study", tmp_path)
    runs = tmp_path / "study" / "runs"
    code, _, err = interrupted(process, lambda: len(list(runs.glob("circular-*.json"))) > 1)
    assert code == 130
    assert "palpate study tomosynthesis --resume --quick -o study" in err
    assert not list((tmp_path / "study").rglob(".*.part-*"))
    for path in runs.glob("*.json"):
        json.loads(path.read_text())
