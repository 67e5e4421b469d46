"""Psychometric functions, QUEST+ and the staircase, asked of simulated observers."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import palpate as pp
from palpate.errors import DataError

RUNS = 500
LEVELS = np.geomspace(0.02, 2.0, 31)
SPAN = (0.02, 2.0)
SLOPES, LAPSES = (0.5, 8.0), (0.0, 0.06)


def observers(rng, count=RUNS):
    """Of random threshold, slope and lapse, anywhere in the prior's range."""
    return [
        pp.PsychometricFunction(
            np.exp(rng.uniform(*np.log(SPAN))), np.exp(rng.uniform(*np.log(SLOPES))), rng.uniform(*LAPSES)
        )
        for _ in range(count)
    ]


def ask(procedure, observer, rng, trials=None):
    """Lets an observer answer, so many times or until the procedure is done."""
    while len(procedure.asked) < trials if trials else not procedure.done:
        level = procedure.next_level()
        procedure.answer(level, rng.random() < observer.probability(level))
    return procedure


def share_held(intervals, truths):
    return np.mean([low <= truth <= high for (low, high), truth in zip(intervals, truths, strict=True)])


def test_quests_interval_holds_the_threshold_as_often_as_it_says():
    rng = np.random.default_rng(1)
    people = observers(rng)
    quests = [ask(pp.Quest(LEVELS), person, rng, 50) for person in people]
    truths = [person.threshold for person in people]
    assert 0.92 <= share_held([quest.interval for quest in quests], truths) <= 0.98
    found = [pp.fit_psychometric(quest.asked, quest.right, threshold=SPAN, draws=0) for quest in quests]
    assert 0.92 <= share_held([fit.interval for fit in found], truths) <= 0.98


def test_so_do_those_of_constant_levels_and_of_a_staircase():
    rng = np.random.default_rng(2)
    people = observers(rng)
    levels = np.repeat(np.geomspace(*SPAN, 9), 20)
    constant = [
        pp.fit_psychometric(levels, rng.random(len(levels)) < person.probability(levels), threshold=SPAN, draws=0)
        for person in people
    ]
    assert 0.92 <= share_held([fit.interval for fit in constant], [person.threshold for person in people]) <= 0.98
    assert 0.92 <= share_held([fit.slope_interval for fit in constant], [person.slope for person in people]) <= 0.98
    stairs = [ask(pp.WeightedUpDown(2.0, lowest=2e-3, highest=2.0), person, rng) for person in people]
    found = [pp.fit_psychometric(stair.asked, stair.right, draws=0) for stair in stairs]
    assert 0.92 <= share_held([fit.interval for fit in found], [person.threshold for person in people]) <= 0.98


@pytest.mark.parametrize("slope", [1.3, 3.5])
def test_the_same_observer_again_and_again_is_held_too(slope):
    """1.3 is d' in proportion to the level. The prior is not an observer's, so the share is near to 95 % and not at it."""
    rng, person = np.random.default_rng(3), pp.PsychometricFunction(0.2, slope, 0.02)
    quests = [ask(pp.Quest(LEVELS), person, rng, 60) for _ in range(200)]
    assert share_held([quest.interval for quest in quests], [0.2] * len(quests)) >= 0.9
    logs = np.log([quest.function.threshold for quest in quests])
    assert abs(logs.mean() - np.log(0.2)) < 0.1
    assert np.exp(logs.std()) < 1.35


def test_quest_needs_fewer_answers_than_constant_levels():
    rng = np.random.default_rng(4)
    people = observers(rng, 60)
    levels = np.repeat(np.geomspace(*SPAN, 10), 6)
    quests = [ask(pp.Quest(LEVELS), person, rng, 60) for person in people]
    constant = [
        pp.fit_psychometric(levels, rng.random(60) < person.probability(levels), threshold=SPAN, draws=0)
        for person in people
    ]
    width = [np.median([np.ptp(np.log(each.interval)) for each in some]) for some in (quests, constant)]
    assert width[0] < 0.75 * width[1]


def test_the_next_level_has_the_least_expected_entropy():
    """Both answers to each level are taken in turn, and the threshold's posteriors looked at."""
    quest = pp.Quest(np.geomspace(0.05, 1, 9))
    rng, person = np.random.default_rng(5), pp.PsychometricFunction(0.3, 2.0, 0.03)
    for _ in range(12):
        expected = []
        for level in quest.levels:
            right = quest.grid.probability(np.array([level]))[0]
            total = 0.0
            for likelihood in (right, 1 - right):
                joint = (quest.weights * likelihood).reshape(quest.grid.shape).sum(axis=(1, 2))
                total += joint.sum() * stats.entropy(joint)
            expected.append(total)
        level = quest.next_level()
        assert expected[list(quest.levels).index(level)] == pytest.approx(min(expected), abs=1e-9)
        quest.answer(level, rng.random() < person.probability(level))


def test_the_same_answers_give_the_same_levels():
    person = pp.PsychometricFunction(0.3, 2.0)
    for make in (lambda: pp.Quest(LEVELS), lambda: pp.WeightedUpDown(2.0)):
        first = ask(make(), person, np.random.default_rng(6), 30)
        again = make()
        for level, right in zip(first.asked, first.right, strict=True):
            assert again.next_level() == level
            again.answer(level, right)
        assert again.next_level() == first.next_level()


def test_a_level_of_ones_own_counts_as_well():
    quest = pp.Quest(LEVELS)
    for level, right in ((0.5, True), (0.1234, True), (0.0321, False), (0.2, True)):
        quest.answer(level, right)
    found = pp.fit_psychometric(quest.asked, quest.right, threshold=SPAN, draws=0)
    assert quest.function.threshold == pytest.approx(found.function.threshold, rel=0.03)
    np.testing.assert_allclose(quest.interval, found.interval, rtol=0.05)


@pytest.mark.parametrize("target", [0.7, 0.75, 0.85])
@pytest.mark.parametrize("slope", [1.3, 3.5])
def test_the_staircase_comes_to_its_target(target, slope):
    """In the long run as much is stepped up as down, so the share of right answers is the target whatever the observer."""
    rng, person = np.random.default_rng(7), pp.PsychometricFunction(0.2, slope, 0.02)
    stair = ask(pp.WeightedUpDown(1.0, step=1.06, target=target, reversals=1200, discard=40), person, rng)
    assert np.mean(stair.right[200:]) == pytest.approx(target, abs=0.02)
    assert person.probability(stair.estimate) == pytest.approx(target, abs=0.025)
    assert stair.estimate == pytest.approx(person.level(target), rel=0.1)


def test_the_staircases_steps():
    stair = pp.WeightedUpDown(1.0, step=1.2, target=0.75, reversals=4, discard=2, lowest=0.8)
    assert np.isnan(stair.estimate)
    for right in (True, True, True, False, True, False):
        assert not stair.done
        stair.answer(stair.next_level(), right)
    steps = [np.log(b / a) / np.log(1.2) for a, b in pairwise([*stair.asked, stair.next_level()])]
    low = np.log(0.8) / np.log(1.2)
    np.testing.assert_allclose(steps, [-1, low + 1, 0, 3, -1, 3], atol=1e-9)  # at the lowest level it stays
    assert not stair.done
    assert stair.estimate != stair.estimate
    stair.answer(stair.next_level(), True)
    assert stair.done
    assert stair.estimate == pytest.approx(np.sqrt(stair.asked[5] * stair.asked[6]))


def test_the_pages_example_runs(capsys):
    page = (Path(__file__).parents[2] / "docs" / "psychophysics.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    names = {}
    exec(code, names)
    assert names["found"].bounded
    assert names["found"].interval[0] < 0.2 < names["found"].interval[1]
    assert capsys.readouterr().out.startswith("threshold 0.")


def test_level_and_probability_undo_each_other():
    person = pp.PsychometricFunction(0.3, 1.7, 0.04)
    for p in (0.51, 0.75, 0.95):
        assert person.probability(person.level(p)) == pytest.approx(p)
    assert person.probability(0.0) == 0.5
    assert person.probability(1e3) == pytest.approx(0.96)
    np.testing.assert_allclose(person.probability([[0.3]]), 0.5 + 0.46 * (1 - np.exp(-1)))
    assert pp.PsychometricFunction(1.0, 1.0, guess=0.25).probability(0) == 0.25  # four alternatives


@pytest.mark.parametrize(
    ("refused", "complaint"),
    [
        (lambda: pp.PsychometricFunction(0.0, 1), "threshold: 0.0"),
        (lambda: pp.PsychometricFunction(1, np.inf), "slope: inf"),
        (lambda: pp.PsychometricFunction(1, 1, 0.5), "lapse: 0.5"),
        (lambda: pp.PsychometricFunction(1, 1, guess=1), "guess: 1"),
        (lambda: pp.PsychometricFunction(1, 1).probability([-1]), "-1.0 is negative"),
        (lambda: pp.PsychometricFunction(1, 1, 0.1).level(0.95), "between guess and 1 - lapse"),
        (lambda: pp.fit_psychometric([], []), "levels: none"),
        (lambda: pp.fit_psychometric([1, 0], [1, 1]), "0.0 is not above 0"),
        (lambda: pp.fit_psychometric([1, np.nan], [1, 1]), "levels: 1 values are not finite"),
        (lambda: pp.fit_psychometric([1, 2], [1]), "1 answers to 2 levels"),
        (lambda: pp.fit_psychometric([1, 2], [1, 0.5]), "right: 0.5"),
        (lambda: pp.fit_psychometric([1, 2], [1, 0], threshold=(2, 1)), "threshold: "),
        (lambda: pp.fit_psychometric([1, 2], [1, 0], slope=(0, 1)), "slope: "),
        (lambda: pp.fit_psychometric([1, 2], [1, 0], lapse=(0, 0.5)), "lapse: "),
        (lambda: pp.fit_psychometric([1, 2], [1, 0], guess=-0.1), "guess: -0.1"),
        (lambda: pp.fit_psychometric([1, 2], [1, 0], draws=-1), "draws: -1"),
        (lambda: pp.Quest([1, 1]), "1 of them"),
        (lambda: pp.Quest([1, 2]).answer(0, True), "0.0 is not above 0"),
        (lambda: pp.Quest([1, 2]).answer(1, 2), "right: 2.0"),
        (lambda: pp.WeightedUpDown(0), "level: 0"),
        (lambda: pp.WeightedUpDown(1, highest=0.5), "level: 1"),
        (lambda: pp.WeightedUpDown(1, step=1), "step: 1"),
        (lambda: pp.WeightedUpDown(1, target=0.5), "target: 0.5"),
        (lambda: pp.WeightedUpDown(1, reversals=5, discard=4), "let two or more count"),
        (lambda: pp.WeightedUpDown(1, lowest=0.5).answer(0.4, True), "level: 0.4"),
    ],
)
def test_bad_input_is_refused(refused, complaint):
    with pytest.raises(DataError, match=complaint):
        refused()
