"""What the study of tomosynthesis says of the chapter's claims, from tables made by hand: each verdict in every way."""

import numpy as np
import pytest

from palpate.report.html_report import Section
from palpate.studies.counterparts import list_counterparts
from palpate.studies.tomosynthesis import claims, pairs
from palpate.studies.tomosynthesis.intervals import Interval, held
from palpate.studies.tomosynthesis.report_sections import counterparts

DOSES, SCANS = (20_000, 2_000), 20
T = {2: 12.706, 5: 2.776, 20: 2.093}  # Student's t, two-sided 95 %, by the number of values: from printed tables


@pytest.mark.parametrize("n", [5, 20])
def test_the_interval_is_that_of_the_printed_table(n):
    logs = np.random.default_rng(n).normal(0.3, 0.1, n)
    one = Interval.of(np.exp(logs))
    half = T[n] * np.sqrt(((logs - logs.mean()) ** 2).sum() / (n - 1) / n)
    assert np.log([one.mean, one.low, one.high]) == pytest.approx(
        logs.mean() + np.array([0, -half, half]), abs=2e-4 * half
    )
    assert one.words == f"{one.mean:.3f} ({one.low:.3f} to {one.high:.3f})"


def test_of_fewer_than_five_scans_the_least_and_the_most_are_told():
    one = Interval.of([2.0, 1.0, 4.0])
    assert (one.mean, one.low, one.high) == pytest.approx((2.0, 1.0, 4.0))


def test_a_mean_of_lower_bounds_stays_one():
    one = Interval.of([4.0] * 6, bound=True)
    assert one.words == "≥ 4.000 (from 4.000)"
    assert one.says == "holds"
    assert Interval.of([0.5] * 6, bound=True).says == "open"  # it may be much more


@pytest.mark.parametrize(
    ("ratios", "says"),
    [
        ([1.03] * 6, "holds"),
        ([1.01] * 6, "equal"),
        ([0.99] * 6, "equal"),
        ([0.97] * 6, "opposite"),
        ([0.8, 1.6, 0.9, 1.5, 1.4], "open"),  # better in the mean, but who knows
        ([1.0, 1.05, 1.02, 1.03, 1.0], "open"),
    ],
)
def test_a_claim_holds_where_the_whole_interval_says_so(ratios, says):
    assert Interval.of(ratios).says == says


def test_where_a_claim_fails_it_is_said_how():
    good, same, bad, wide = (Interval.of(r) for r in ([1.5] * 6, [1.0] * 6, [0.5] * 6, [0.5, 2.0] * 3))
    assert held([("a", good), ("b", good)]) == "holds at every dose"
    assert (
        held([("a", good), ("b", same), ("c", bad)])
        == "holds at 1 of 3 doses (the opposite holds at c; equal within 2% at b)"
    )
    assert held([("a", bad), ("b", wide)]) == "holds at no dose (the opposite holds at a; not decided at b)"
    assert held([("a", good)]) == "holds"
    assert held([("a", bad)]) == "does not hold (the opposite holds)"


def made(
    back=1.0, multi=0.8, passes=3.0, bound=False, equal=1.2, ring=9.0, streak=9.0, subsets=(12, 20), came=True, others=8
):
    """Tables in which backprojection has that error, M-MAP that one, and so on; a pair gives one a dose."""
    each = {name: value if isinstance(value, tuple) else (value, value) for name, value in
            {"back": back, "multi": multi, "passes": passes, "equal": equal}.items()}  # fmt: skip
    rng = np.random.default_rng(1)
    tables = {name: [] for name in ("convergence", "direct", "pairs", "motions", "subsets")}

    def merits(error):
        return {"nmse": error, "nmse_region": error, "ssim": 1 / error, "cnr": 1 / error}

    for k, dose in enumerate(DOSES):
        for seed in range(SCANS):
            same, noise = {"dose": dose, "seed": seed}, np.exp(rng.normal(0, 0.003))
            tables["direct"].append({**same, **merits(each["back"][k])})
            for method, optimiser, start in claims.RUNS:
                run = {"method": method, "optimiser": optimiser, "start": start, "passes": 12.0}
                tables["convergence"].append({**same, **run, **merits(each["multi"][k] * noise)})
            for pair in pairs.PAIRS:
                row = {
                    "pair": pair.words,
                    **same,
                    "passes": each["passes"][k] * noise,
                    "passes_bound": bound and seed == 3,
                }
                errors = {f"{at}_{of}": each["equal"][k] * noise for at in claims.AT for of in pairs.ERRORS}
                tables["pairs"].append(row | errors)
            for kind in ("plain", "with momentum"):
                for count, spent in zip((1, 2, 4), (subsets[1], subsets[0], subsets[1]), strict=True):
                    row = {
                        **same,
                        "momentum": kind,
                        "subsets": count,
                        "passes": spent,
                        "reached": came,
                        "others": others,
                    }
                    tables["subsets"].append(row)
    for seed in range(SCANS):
        for motion in ("circular", "linear", "hypocycloidal"):
            for method, error in (("backprojection", each["back"][0]), ("map", each["multi"][0])):
                row = {"dose": 20_000, "seed": seed, "motion": motion, "method": method, "ring": ring, "streak": streak}
                tables["motions"].append(row | merits(error))
    return tables


@pytest.mark.parametrize(
    ("given", "claim", "verdict"),
    [
        ({}, "M-MAP-3 gives better images than backprojection; tried by NMSE of the full field, descent from a uniform",
         "holds at every dose: backprojection's over M-MAP-3's 20k 1.25"),
        ({"multi": (0.8, 0.99)}, "M-MAP-2 gives better images than backprojection; tried by NMSE of the full field, descent "
         "from a backprojection", "holds at 1 of 2 doses (equal within 2% at 2k): "),
        ({"multi": 1.3}, "M-MAP-3 gives better images than backprojection; tried by NMSE of the full field, momentum",
         "holds at no dose (the opposite holds at 20k, 2k): "),
        ({}, "M-MAP-3 needs less computation than F-MAP; tried by passes over the voxels until the log-posterior at which "
         "M-MAP-3 stopped (M-MAP-3, descent, uniform", "holds at every dose: F-MAP's over M-MAP-3's 20k 3.00"),
        ({"bound": True}, "stopped (M-MAP-3, descent, uniform", "holds at every dose: F-MAP's over M-MAP-3's 20k ≥ 3.0"),
        ({"passes": (0.9, 1.0)}, "stopped (M-MAP-2, descent, backprojection",
         "holds at no dose (the opposite holds at 20k; equal within 2% at 2k): "),
        ({}, "better images than F-MAP; tried after the same number of passes by NMSE of the full field (M-MAP-3, descent, u",
         "holds at every dose: F-MAP's over M-MAP-3's 20k 1.20"),
        ({"equal": (1.2, 0.9)}, "better images than F-MAP; tried each at its own stop by NMSE of the full field (M-MAP-2, "
         "descent, u", "holds at 1 of 2 doses (the opposite holds at 2k): "),
        ({}, "not than F-MAP alone", "holds at no dose (the opposite holds at 20k, 2k): backprojection's single pass over "
         "those of M-MAP-3 20k 0.083 ("),
        ({}, "into rings", "holds at every motion: power circular motion 9.000 (9.000 to 9.000), linear motion 9.000 ("),
        ({"streak": 0.9}, "into rings", "holds at 1 of 2 motions (the opposite holds at linear motion): "),
        ({}, "hypocycloidal motion is a str", "holds: backprojection's over M-MAP-3's 20k 1.25"),
        ({"multi": (1.3, 0.8)}, "linear motion is a str", "does not hold (the opposite holds): "),
        ({}, "tried on the finest grid, plain", "holds at every dose: theirs over the better of descent and momentum without "
         "subsets 20k 1.500 (1.500 to 1.500), 2k 1.500 ("),
        ({}, "tried on the finest grid, plain", "over their own algorithm without subsets they gain 20k 1.667 (1.667 to "
         "1.667) with 2 subsets, 2k 1.667 ("),
        ({"subsets": (4, 20)}, "tried on the finest grid, with momentum",
         "holds at no dose (the opposite holds at 20k, 2k): "),
        ({"subsets": (8, 20)}, "tried on the finest grid, with momentum", "holds at no dose (equal within 2% at 20k, 2k): "),
        ({"came": False}, "tried on the finest grid, plain", "holds at every dose: theirs over the better of descent and "
         "momentum without subsets 20k ≥ 1.500 (from 1.500)"),
        ({"came": False}, "tried on the finest grid, plain", "they gain 20k not told, for neither came there"),
    ],
)  # fmt: skip
def test_claims_of_the_tomosynthesis_study_follow_their_tables(given, claim, verdict):
    (found,) = [one.sentence for one in claims.claims(made(**given)) if claim in one.sentence]
    assert found.startswith("The chapter claims that ")
    assert "on 20 scans" in found
    assert verdict in found.split(", this ", 1)[1]


def test_other_measures_follow_the_direction_in_which_they_are_better():
    for one in claims.by_other_measures(made(multi=(0.8, 1.3), equal=1.2)):
        if "backprojection;" in one.sentence:
            assert one.held == "holds at 1 of 2 doses (the opposite holds at 2k)"
        else:
            assert one.held == "holds at every dose"


def test_no_verdict_is_told_twice():
    said = [(v.claim, v.tried) for v in claims.claims(made()) + claims.by_other_measures(made())]
    assert len(said) == len(set(said)) > 30


def run(method, optimiser, passes, posterior, stop, **more):
    """A record with iterates of these passes and posteriors, and errors that follow the posterior."""
    trace = {"passes": passes, "cpu": [p / 10 for p in passes], "posterior": posterior, "level": [0] * len(passes)}
    trace |= {error: [p / 100 for p in posterior] for error in pairs.ERRORS}
    quality = {error: trace[error][stop] for error in pairs.ERRORS}
    return {"experiment": "convergence", "dose": 1, "seed": 0, "method": method, "optimiser": optimiser,
            "start": "backprojection", "trace": trace, "stop": stop, "quality": quality, **more}  # fmt: skip


def test_work_counts_to_the_first_moment_at_which_f_map_is_as_low():
    multi = run("M-MAP-3", "descent", [1.0, 2.0, 3.0, 4.0], [9.0, 6.0, 5.5, 5.0], 2)
    fixed = run("F-MAP", "descent", [1.0, 2.0, 6.0, 9.0], [9.0, 8.0, 5.0, 4.0], 3)
    (row,) = pairs.pair_rows([multi, fixed])
    assert row["passes"] == pytest.approx(6 / 3)
    assert not row["passes_bound"]
    assert row["equal_nmse"] == pytest.approx(8.0 / 5.5)  # after 3 passes F-MAP stands at its second iterate
    assert row["stop_nmse_region"] == pytest.approx(4.0 / 5.5)
    never = run("F-MAP", "descent", [1.0, 2.0, 6.0, 9.0], [9.0, 8.0, 7.0, 6.0], 3)
    (row,) = pairs.pair_rows([multi, never])
    assert row["passes"] == pytest.approx(9 / 3)
    assert row["passes_bound"]
    assert row["cpu_bound"]


def test_ordered_subsets_are_judged_where_descent_stands_after_its_passes():
    descent = run("F-MAP", "descent", [1.0, 2.0, 3.0, 4.0], [9.0, 8.0, 7.0, 6.0], 3)
    momentum = run("F-MAP", "momentum", [1.0, 2.0, 3.0], [9.0, 6.9, 5.0], 2)
    about = {"experiment": "subsets", "momentum": "plain"}
    trials = [
        run(None, None, [1.0, 3.0], posterior, 1, **about, subsets=s)
        for s, posterior in ((2, [8.0, 6.5]), (4, [8.0, 7.5]))
    ]
    good, bad = pairs.subset_rows([descent, momentum, *trials], 3)
    assert (good["passes"], good["reached"], good["descent"], good["memory_gradient"], good["others"]) == (
        3,
        True,
        3,
        2,
        2,
    )
    assert (bad["passes"], bad["reached"]) == (3, False)
    assert good["others_s"] == pytest.approx(0.2)


def test_every_counterpart_of_a_figure_is_asked_to_be_there():
    wanted = counterparts((200_000, 20_000, 2_000))
    pictures = [(b"", "")] * 12
    sections = [Section(title, (), [["a"]], pictures) for title in {row[2] for row in wanted}]
    assert len(list_counterparts(sections, wanted, ()).table) == len(wanted) + 1
    with pytest.raises(KeyError):
        list_counterparts(sections[1:], wanted, ())
    with pytest.raises(ValueError, match="has no picture 2"):
        list_counterparts([Section(s.title, (), s.table, pictures[:1]) for s in sections], wanted, ())
