"""Forced-choice experiments: orders, the file of answers, what may be fitted together, the ideal observer."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm
from support.example_organs import ellipsoid

import palpate as pp
from palpate.meshes.tet_mesh import TetMesh
from palpate.simulation.answer_file import append_trial
from palpate.simulation.answer_fit import threshold_text
from palpate.simulation.interval_tissue import stimulus


@pytest.fixture(scope="module")
def plain():
    mesh = ellipsoid(9)
    one = TetMesh(mesh.nodes, mesh.tets, np.ones(len(mesh.tets), dtype=np.int32), {1: "organ"})
    return pp.Tissue(one, 5.0, 0.45, pp.resting_on(one, (0, 0, -1), depth=8.0))


def trial(number, experiment, right=True, level=0.2, **changes):
    order = experiment.orders[number - 1]
    named = order if right else 3 - order
    one = pp.Trial(number, experiment.question, level, order, named, 4.5, experiment.channel, (1.0, 1.2))
    return replace(one, **changes)


def test_orders_are_balanced_and_differ_between_seeds():
    orders = np.array([pp.ForcedChoice(trials=40, seed=seed).orders for seed in range(400)])
    assert (np.count_nonzero(orders == 1, axis=1) == 20).all(), "in each experiment both come as often"
    share = (orders == 1).mean(axis=0)
    assert np.abs(share - 0.5).max() < 4 * np.sqrt(0.25 / 400), "no trial prefers an interval"
    assert len({tuple(one) for one in orders}) == 400
    again = (orders[:, 1:] == orders[:, :-1]).mean()
    assert abs(again - 19 / 39) < 0.02, "an order tells nothing of the next one but that both come as often"


@pytest.mark.parametrize("procedure", ["quest", "staircase"])
def test_a_procedure_follows_the_answers_alone(procedure):
    experiment = pp.ForcedChoice(procedure=procedure, trials=50)
    observer, rng, said = pp.PsychometricFunction(0.2, 1.5), np.random.default_rng(3), []
    while (level := experiment.next_level(said)) is not None:
        assert experiment.next_level(list(said)) == level
        assert experiment.levels[0] <= level <= experiment.levels[-1]
        said.append((level, bool(rng.random() < observer.probability(level))))
    low, high = pp.fit_psychometric(*zip(*said, strict=True)).interval
    assert len(said) <= 50
    assert low < 0.2 < high


def test_a_death_loses_no_answer(tmp_path):
    experiment, path = pp.ForcedChoice(trials=9, seed=5), tmp_path / "answers.jsonl"
    pp.start_answers(path, pp.Answers(experiment, "organ"))
    for k in range(1, 5):
        append_trial(path, trial(k, experiment, right=k != 2))
    whole = pp.read_answers(path)
    assert whole.experiment == experiment
    assert [one.right for one in whole.trials] == [True, False, True, True]
    cut = path.read_bytes()[:-20]
    path.write_bytes(cut)
    assert pp.read_answers(path).trials == whole.trials[:3]
    append_trial(path, trial(4, experiment))
    assert pp.read_answers(path).trials[3].right, "what was cut short made room"
    assert "name" not in path.read_text()
    with pytest.raises(pp.errors.FileError, match="--resume"):
        pp.start_answers(path, pp.Answers(experiment, "organ"))


@pytest.mark.parametrize(
    "changed",
    [
        lambda lines: ["{}", *lines[1:]],
        lambda lines: [lines[0], lines[2]],
        lambda lines: [lines[0], "[1, 2]"],
        lambda lines: [lines[0], lines[1].replace('"order": ', '"order": 1')],
        lambda lines: [lines[0].replace("quest", "guess"), *lines[1:]],
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path, changed):
    experiment, path = pp.ForcedChoice(trials=9), tmp_path / "answers.jsonl"
    pp.start_answers(path, pp.Answers(experiment, "", (trial(1, experiment), trial(2, experiment))))
    path.write_text("\n".join(changed(path.read_text().splitlines())) + "\n")
    with pytest.raises(pp.errors.FileError, match=r"answers\.jsonl"):
        pp.read_answers(path)


def test_answers_of_two_channels_are_not_pooled():
    experiment = pp.ForcedChoice(trials=20)
    trials = [trial(k, experiment) for k in range(1, 21)]
    assert pp.fit_answers(trials).function.threshold > 0
    for changes in ({"channel": "device"}, {"question": "lump"}):
        with pytest.raises(pp.errors.DataError, match="together"):
            pp.fit_answers([*trials[:-1], replace(trials[-1], **changes)])


def test_who_guesses_has_no_threshold():
    experiment, rng = pp.ForcedChoice(trials=60), np.random.default_rng(1)
    said = []
    while (level := experiment.next_level(said)) is not None:
        said.append((level, bool(rng.random() < 0.5)))
    found = pp.fit_psychometric(*zip(*said, strict=True))
    assert not found.bounded
    assert threshold_text(found).startswith("no threshold")
    assert not any(letter.isdigit() for letter in threshold_text(found))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"question": "colour"}, "question"),
        ({"procedure": "guess"}, "procedure"),
        ({"channel": "smell"}, "channel"),
        ({"trials": 0}, "trials"),
        ({"seed": -1}, "seed"),
        ({"diameter": np.nan}, "diameter"),
        ({"levels": (0.1,)}, "levels"),
        ({"levels": (0.1, np.nan)}, "levels"),
    ],
)
def test_an_experiment_that_cannot_be_is_refused(changes, words):
    with pytest.raises(pp.errors.DataError, match=words):
        pp.ForcedChoice(**changes)


def test_a_lump_is_where_it_is_said_to_be(plain):
    for seed in range(4):
        what = stimulus(pp.ForcedChoice("lump", seed=seed, diameter=16), plain)
        stiff = what.tissue(plain, 3.0)
        assert set(np.unique(stiff.young)) == {5.0, 20.0}
        middles = plain.mesh.nodes[plain.mesh.tets][what.stiffer].mean(axis=1)
        assert np.linalg.norm(middles - (what.place - 11 * what.normal), axis=1).max() <= 8
        assert stiff.mesh is plain.mesh
    with pytest.raises(pp.errors.DataError, match="diameter"):
        stimulus(pp.ForcedChoice("lump", diameter=70), plain)


def test_the_ideal_observer_has_the_threshold_of_its_noise(plain):
    """Gaussian force of known relative deviation: P(level) = Φ(level / (w √(1 + (1 + level)²)))."""
    weber = 0.07
    found = pp.ideal_observer(pp.ForcedChoice(), plain, force_step=0, length_step=0, weber=weber, answers=3000)
    expected = brentq(lambda x: norm.cdf(x / (weber * np.hypot(1, 1 + x))) - found.function.probability(0.15), 1e-3, 1)
    assert found.bounded
    assert abs(expected - 0.15) < 0.01


def test_a_coarser_readout_raises_the_ideal_threshold(plain):
    """Uniform rounding and one exact depth: below the step of force nothing differs but by luck."""
    top = np.array((0.0, 0.0, 25.0))
    kept = [pp.ideal_observer(pp.ForcedChoice(), plain, point=top, force_step=s, length_step=0) for s in (0.02, 0.2)]
    assert kept[1].function.threshold > 4 * kept[0].function.threshold


def test_a_lump_is_harder_to_find_than_a_stiffer_organ(plain):
    """A small part of what gives way becomes stiffer."""
    lump, whole = (
        pp.ideal_observer(pp.ForcedChoice(q, diameter=16, seed=1), plain, length_step=0.2)
        for q in ("lump", "stiffness")
    )
    assert lump.function.threshold > 2 * whole.function.threshold


def test_the_file_is_json_that_others_can_read(tmp_path):
    experiment, path = pp.ForcedChoice(trials=2), tmp_path / "answers.jsonl"
    pp.start_answers(path, pp.Answers(experiment, "x", (trial(1, experiment),)))
    head, one = map(json.loads, path.read_text().splitlines())
    assert head["question"] == "stiffness"
    assert one["right"] is True
    assert one["channel"] == "screen"
    assert one["force"] == [1.0, 1.2]
