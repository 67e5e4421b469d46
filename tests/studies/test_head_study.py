"""The head study: nothing is chosen with the view that is judged, and the report says who predicts best."""

import csv
import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.reconstruction.models.likelihood import WeightedLeastSquares
from palpate.reconstruction.optimizers.coordinate_descent import data_curvature
from palpate.reconstruction.prior_parameters import choose_prior_parameters, median_curvature
from palpate.studies.head import leave_one_view_out, study
from palpate.studies.head.report_sections import at_the_end, ranks


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as shorter:  # lists of candidates: the way is the same
        for name, iterations in {"MOST": 15, "COARSE_SIRT": 50, "SIRT_EVERY": 5, "LONGEST": 3}.items():
            shorter.setattr(leave_one_view_out, name, iterations)
        result = CliRunner().invoke(app, ["study", "head", "--quick", "-o", str(folder)])
    assert result.exit_code == 0, result.output
    assert "report.html" in result.output
    return folder


def test_the_quick_study_writes_report_scores_and_folds(folder):
    rows = list(csv.DictReader((folder / "scores.csv").open()))
    named = {row["method"] for row in rows}
    assert {"M-MAP", "SART", "SIRT", "FBP", "backprojection", "neighbours"} <= named
    assert {int(row["view"]) for row in rows} == set(range(4))
    scores = np.array([[float(row["full band"]), float(row["high-passed"])] for row in rows])
    assert (np.abs(scores) <= 1).all()
    full = {name: np.mean([float(r["full band"]) for r in rows if r["method"] == name]) for name in named}
    assert full["M-MAP"] > max(full["backprojection"], full["FBP"])
    report = (folder / "report.html").read_text()
    for title in ("Conclusions", "Before and after correction", "What was chosen without the view", "Slices"):
        assert title in report
    assert report.count("<img") >= 8


def test_a_resumed_study_takes_the_folds_that_are_there(folder):
    fold = json.loads((folder / "view_3.json").read_text())
    fold["scores"]["SIRT"] = [0.123456, 0.5]
    (folder / "view_3.json").write_text(json.dumps(fold))
    pp.head_study(folder, quick=True, resume=True, docs=folder / "docs")
    assert "0.12346" in (folder / "report.html").read_text()
    page = (folder / "docs" / "head.md").read_text()
    assert "0.12346" in page
    for picture in re.findall(r"\]\((images/head/.*?)\)", page):
        assert (folder / "docs" / picture).stat().st_size > 1000


def test_each_view_is_left_out_together_with_another_and_never_a_neighbour():
    for views in (4, 6, 7, 11, 15):
        groups = leave_one_view_out.groups(views)
        assert sorted(k for group in groups for k in group) == list(range(views))
        assert all(len(group) > 1 and np.diff(group).min() >= 2 for group in groups)


def test_the_choice_for_a_view_never_looks_at_its_own_scores():
    rng = np.random.default_rng(1)
    names = ["a", "b", "c"]
    inner = {
        group: {n: rng.uniform(0.5, 0.99, (len(group), 2)) for n in names} for group in leave_one_view_out.groups(11)
    }
    for view in range(11):
        chosen = leave_one_view_out.choose_candidate(view, 11, inner)
        for _ in range(5):
            other = {
                group: {
                    n: np.where((np.array(group) == view)[:, None], rng.uniform(-1, 1, s.shape), s)
                    for n, s in of.items()
                }
                for group, of in inner.items()
            }
            assert leave_one_view_out.choose_candidate(view, 11, other) == chosen


def test_the_candidate_that_predicts_the_partners_best_is_chosen():
    inner = {group: {name: np.full((len(group), 2), 0.5) for name in "abc"} for group in leave_one_view_out.groups(11)}
    inner[(3, 7)]["b"] = np.array([[0.5, 0.5], [0.9, 0.9]])  # view 7 well predicted: for view 3
    inner[(3, 7)]["c"] = np.array([[0.9, 0.9], [0.5, 0.5]])
    assert leave_one_view_out.choose_candidate(3, 11, inner) == "b"
    assert leave_one_view_out.choose_candidate(7, 11, inner) == "c"
    inner[(2, 6, 10)]["b"] = np.array([[0.6, 0.6], [0.6, 0.6], [0.99, 0.99]])  # the outermost view has no say
    inner[(2, 6, 10)]["c"] = np.array([[0.7, 0.7], [0.7, 0.7], [0.1, 0.1]])
    assert [leave_one_view_out.choose_candidate(k, 11, inner) for k in (2, 6, 10)] == ["c", "c", "c"]


def test_the_left_out_image_changes_nothing_but_its_score(monkeypatch):
    monkeypatch.setattr(leave_one_view_out, "MOST", 10)
    scan = pp.import_scan("head")[::3]
    levels = leaving_levels(scan)
    counts = scan.counts.copy()
    counts[2] = np.where(scan.mask[2], counts[3], 0)  # another image in its place
    swapped = leaving_levels(pp.Scan(counts, scan.incident, scan.views, scan.background, scan.mask))
    volumes = [leave_one_view_out.coarse_map(leave_one_view_out.leave_out(each, [2])) for each in (levels, swapped)]
    assert np.array_equal(*volumes)
    found = [
        study.corrections(scan, each, leave_one_view_out.view_scores(scan), [2])[1]
        for each in (levels[-1:], swapped[-1:])
    ]
    for name in study.CORRECTIONS:
        assert np.array_equal(found[0][name].shifts, found[1][name].shifts)
        assert np.array_equal(found[0][name].gains, found[1][name].gains)


def test_a_fit_runs_until_more_iterations_gain_little():
    scan, grid = leaving_levels(pp.import_scan("head")[::3])[-1]
    ended = {n: next(leave_one_view_out.map_path(scan, grid, (1.0,), n, None, 2e-3))[1] for n in (200, 400)}
    assert np.array_equal(ended[200], ended[400])  # it ended by itself
    A, data = pp.Projector(scan.views, grid), WeightedLeastSquares.of(scan)
    known = data_curvature(A, data)
    prior = choose_prior_parameters(pp.Prior(), A, data, known)

    def objective(values):
        return data.value(A(values)) + prior.strength * median_curvature(known) * prior.value(values, grid)

    further = objective(next(leave_one_view_out.map_path(scan, grid, (1.0,), 10, ended[200]))[1])
    assert further <= objective(ended[200]) <= further / (1 - 10 * 2e-3)


def leaving_levels(scan):
    from palpate.reconstruction.multiresolution import pyramid

    return pyramid(scan, study.GRID, 5, "sum")[3:]


def test_scores_are_blind_to_gain_and_offset():
    score = leave_one_view_out.view_scores(pp.import_scan("head")[:1])[0]
    rng = np.random.default_rng(0)
    image = score.measured + rng.normal(0, 0.05, score.measured.shape)
    assert np.allclose(score(1.7 * image + 0.3), score(image), atol=1e-4)
    assert np.allclose(score(score.measured), 1)


def test_the_null_model_at_the_ends_is_the_one_neighbour():
    panel = leave_one_view_out.view_scores(pp.import_scan("head")[:3])
    null = leave_one_view_out.null_scores(panel)
    assert np.allclose(null[0], panel[0](panel[1].measured))
    assert np.allclose(null[1], panel[1]((panel[0].measured + panel[2].measured) / 2))


def test_what_is_not_beaten_is_said():
    fold = {"scores": {"M-MAP": [0.9, 0.5], "SART": [0.95, 0.4]}}
    assert ranks([fold], np.array([[0.8, 0.6]])) == {"SART": [[0], []], "mean of the neighbours": [[], [0]]}


def test_choices_at_the_ends_of_their_lists_are_counted():
    folds = [{"chosen": {"SART": name, "FBP": "b", "backprojection": "-"}} for name in ("x: a", "y: c", "x: b")]
    tried = [["x: a", "x: b", "x: c", "y: a", "y: b", "y: c"]] * 3
    lists = {"SART": tried, "FBP": [["a", "b", "c"]] * 3, "backprojection": [["-"]] * 3}
    assert at_the_end(folds, lists) == {"SART": (1, 1), "FBP": (0, 0)}


def test_a_list_grows_until_its_last_candidates_are_worse_for_every_view():
    group, worse = (3, 7), leave_one_view_out.WORSE
    for best in (1, 2, 5):
        quality = [0.9 - 0.05 * abs(n - best) for n in range(20)]
        tried = {}
        for n, q in enumerate(quality):
            tried[str(n)] = np.array([[q, q], [quality[max(n - 1, 0)]] * 2])  # view 7's is best one candidate later
            if leave_one_view_out.past_the_best(11, group, tried):
                break
        assert len(tried) == best + 1 + worse + 1
        assert leave_one_view_out.choose_candidate(3, 11, {group: tried}) == str(best + 1)
        assert leave_one_view_out.choose_candidate(7, 11, {group: tried}) == str(best)


def test_candidates_run_half_as_long_again_or_a_third():
    counts = list(leave_one_view_out.candidate_counts())
    assert counts[:8] == [1, 2, 3, 4, 6, 8, 12, 16]
    assert counts == sorted(set(counts))


def test_the_chosen_candidate_is_made_again_as_it_was_scored():
    levels = leaving_levels(pp.import_scan("head")[::3])
    (path, *_) = leave_one_view_out.sart_estimates(levels)
    name, values = next(path)
    assert np.array_equal(study._estimate("SART", levels, name), values)
