"""The chapter's claims, each a verdict with intervals over the scans, whatever they turn out to be."""

from collections.abc import Mapping, Sequence

from palpate.report.tables import Row, distinct, where
from palpate.studies.tomosynthesis.experiments import MOTION_DOSE
from palpate.studies.tomosynthesis.ghost_shape import SLICE
from palpate.studies.tomosynthesis.intervals import Interval, held
from palpate.studies.tomosynthesis.pairs import PAIRS, interval
from palpate.studies.tomosynthesis.tables import photons
from palpate.studies.verdict import Verdict

Tables = Mapping[str, list[Row]]
FULL_FIELD = "nmse"  # the measure of the chapter
MEASURES = {  # of images: name, and whether lower is better
    FULL_FIELD: ("NMSE of the full field", True),
    "nmse_region": ("NMSE of the region", True),
    "ssim": ("SSIM", False),
    "cnr": ("contrast to noise", False),
}
RUNS = (  # method, optimiser, start: the chapter's own, and the posterior that descent stops short of
    ("M-MAP-3", "descent", "uniform"),
    ("M-MAP-3", "descent", "backprojection"),
    ("M-MAP-2", "descent", "uniform"),
    ("M-MAP-2", "descent", "backprojection"),
    ("M-MAP-3", "momentum", "backprojection"),
)
CLAIMED = [pair.words for pair in PAIRS if pair.claimed]


def claims(tables: Tables) -> list[Verdict]:
    """By the chapter's own measures."""
    found = [against_backprojection(tables, run, FULL_FIELD) for run in RUNS]
    found += [work(tables["pairs"], pair) for pair in CLAIMED]
    found += [against_fixed(tables["pairs"], pair, at, FULL_FIELD) for at in AT for pair in CLAIMED]
    return [*found, _by_the_word(tables), _rings_and_streaks(tables), *_other_motions(tables), *_subsets(tables)]


def by_other_measures(tables: Tables) -> list[Verdict]:
    """The claims about images, by measures that the slab's walls do not rule."""
    others = [name for name in MEASURES if name != FULL_FIELD]
    found = [against_backprojection(tables, run, measure) for measure in others for run in RUNS]
    return found + [against_fixed(tables["pairs"], pair, at, "nmse_region") for at in AT for pair in CLAIMED]


def against_backprojection(tables: Tables, run: tuple[str, str, str], measure: str) -> Verdict:
    """Whether a run at its own stop gives better images than backprojection."""
    method, optimiser, start = run
    words, lower = MEASURES[measure]
    each = []
    for dose, some in _by_dose(where(tables["convergence"], method=method, optimiser=optimiser, start=start)):
        back = {r["seed"]: r[measure] for r in where(tables["direct"], dose=dose)}
        each.append((photons(dose), Interval.of(_better(back[r["seed"]], r[measure], lower) for r in some)))
    over = f"backprojection's over {method}'s" if lower else f"{method}'s over backprojection's"
    return _verdict(
        f"{method} gives better images than backprojection", f"by {words}, {optimiser} from a {start} start", each, over
    )


def _better(theirs: float, ours: float, lower: bool) -> float:
    return theirs / ours if lower else ours / theirs


AT = {  # columns of `pair_rows`: what is compared
    "equal": "after the same number of passes",
    "stop": "each at its own stop",
}


def work(rows: Sequence[Row], pair: str) -> Verdict:
    """Whether multi-resolution is sooner where it stops."""
    each = [(photons(dose), interval(some, "passes")) for dose, some in _by_dose(where(rows, pair=pair))]
    method = pair.split(",")[0]
    tried = f"by passes over the voxels until the log-posterior at which {method} stopped ({pair})"
    return _verdict(f"{method} needs less computation than F-MAP", tried, each, f"F-MAP's over {method}'s")


def against_fixed(rows: Sequence[Row], pair: str, at: str, measure: str) -> Verdict:
    """Whether multi-resolution gives better images than fixed resolution."""
    each = [(photons(dose), interval(some, f"{at}_{measure}")) for dose, some in _by_dose(where(rows, pair=pair))]
    method = pair.split(",")[0]
    tried = f"{AT[at]} by {MEASURES[measure][0]} ({pair})"
    return _verdict(f"{method} gives better images than F-MAP", tried, each, f"F-MAP's over {method}'s")


def _by_the_word(tables: Tables) -> Verdict:
    each = []
    for dose, some in _by_dose(where(tables["convergence"], method="M-MAP-3", optimiser="descent", start="uniform")):
        each.append((photons(dose), Interval.of(1 / r["passes"] for r in some)))
    tried = "by the word, in passes over the voxels until descent from a uniform start stops"
    claim = "M-MAP-3 gives better images at less computation than backprojection, not than F-MAP alone"
    return _verdict(claim, tried, each, "backprojection's single pass over those of M-MAP-3")


def _rings_and_streaks(tables: Tables) -> Verdict:
    rows = where(tables["motions"], method="backprojection")
    each = [
        (f"{motion} motion", Interval.of(r[shape] for r in where(rows, motion=motion)))
        for motion, shape in (("circular", "ring"), ("linear", "streak"))
    ]
    claim = "circular motion blurs what lies in other slices into rings, and linear motion into streaks"
    tried = (
        f"by what backprojection leaves of the ball at z = 70 mm in the slice at {SLICE:g} mm: power on the ring over that "
        "at its centre (circular), and its second moment along the motion over that across (linear)"
    )
    return _verdict(claim, tried, each, "power", "motion")


def _other_motions(tables: Tables) -> list[Verdict]:
    """That other paths of the source ask for no more than their focal spots."""
    found = []
    for motion in [name for name in distinct(tables["motions"], "motion") if name != "circular"]:
        rows = where(tables["motions"], motion=motion)
        back = {r["seed"]: r[FULL_FIELD] for r in where(rows, method="backprojection")}
        one = Interval.of(back[r["seed"]] / r[FULL_FIELD] for r in where(rows, method="map"))
        tried = "with nothing changed but the focal spots, against backprojection, by NMSE of the full field"
        claim = f"{motion} motion is a straightforward extension"
        found.append(_verdict(claim, tried, [(photons(MOTION_DOSE), one)], "backprojection's over M-MAP-3's"))
    return found


def _subsets(tables: Tables) -> list[Verdict]:
    """Whether ordered subsets, with the number of them that suits best, are no sooner than what has none."""
    found = []
    for kind in distinct(tables["subsets"], "momentum"):
        rows = where(tables["subsets"], momentum=kind)
        against, own = [], []
        for dose, some in _by_dose(rows):
            count = best_count(some)
            each = where(some, subsets=count)
            bound = not all(r["reached"] for r in each)
            against.append((photons(dose), Interval.of((r["passes"] / r["others"] for r in each), bound)))
            alone = where(some, subsets=1)
            gain = [a["passes"] / r["passes"] for a, r in zip(alone, each, strict=True)]
            words = Interval.of(gain, not all(r["reached"] for r in alone)).words
            own.append(f"{photons(dose)} {'not told, for neither came there' if bound else words} with {count} subsets")
        tried = (
            f"on the finest grid, {kind}, with the number of subsets that suits them best, by passes over all "
            "projections to one log-posterior"
        )
        over = "theirs over the better of descent and momentum without subsets"
        one = _verdict("ordered subsets are of little use with so few projections", tried, against, over)
        more = f"{one.numbers}; over their own algorithm without subsets they gain {', '.join(own)}"
        found.append(Verdict(one.claim, one.tried, one.held, more))
    return found


def best_count(rows: Sequence[Row]) -> int:
    """The number of subsets, more than one, that needs the fewest passes in the mean; one that came there goes first."""
    counts = [count for count in distinct(rows, "subsets") if count > 1]

    def order(count: int) -> tuple[bool, float]:
        some = where(rows, subsets=count)
        return not all(r["reached"] for r in some), sum(r["passes"] for r in some)

    return int(min(counts, key=order))


def _by_dose(rows: Sequence[Row]) -> list[tuple[int, list[Row]]]:
    return [(dose, where(rows, dose=dose)) for dose in sorted(distinct(rows, "dose"), reverse=True)]


def _verdict(claim: str, tried: str, each: Sequence[tuple[str, Interval]], over: str, what: str = "dose") -> Verdict:
    """each: by dose or `what`. over: what the numbers are."""
    scans = sorted({one.count for _, one in each})
    on = f"{tried}, on {' to '.join(map(str, scans[:: len(scans) - 1 or 1]))} scan{'s' * (scans[-1] > 1)} a dose"
    return Verdict(claim, on, held(each, what), f"{over} {', '.join(f'{name} {one.words}' for name, one in each)}")
