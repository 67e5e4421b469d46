"""What each reading of the chapter's set-up says of its claims: how many of how many reproduce each, and which."""

from collections.abc import Callable, Mapping, Sequence

from palpate.report.tables import Row, distinct, shown, where
from palpate.studies.deformation.config import MARKS
from palpate.studies.verdict import Verdict, outcome

Tables = Mapping[str, list[Row]]
LIMIT = 1.0  # mm, the dissertation's at 5 mm
SAME = 0.05  # share by which one law must be better to count so
PARTS = ("contact", "support", "measure", "law")  # of a reading
MESH_PARTS = ("contact", "support", "measure", "choice")  # of one on another mesh
REST_PARTS = ("contact", "measure", "way")  # of one with rest length
MOST_NAMED = 6


def below_limit(row: Row) -> bool:
    """Whether the worst node is below the limit."""
    return bool(row["worst_mm"] < LIMIT)


def rsc_in_range(row: Row) -> bool:
    """To two decimals, as the chapter gives it."""
    return bool(min(MARKS) <= round(row["rsc"], 2) <= max(MARKS))


def better_than_uniform(row: Row) -> bool:
    """Than the best uniform RSC, by more than counts as the same."""
    return bool(row["uniform_mm"] > (1 + SAME) * row["error_mm"])


def better_than_low_and_high(row: Row) -> bool:
    """Than both uniform RSC that stand for the chapter's low and high."""
    return bool(row["low_high_mm"] > (1 + SAME) * row["error_mm"])


Test = Callable[[Row], bool]
CLAIMS: dict[str, tuple[str, Test]] = {
    "below 1 mm": ("an adaptive RSC keeps the difference to finite elements below 1 mm at 5 mm", below_limit),
    "RSC0": (f"the best RSC0 lies between {max(MARKS):.2f} and {min(MARKS):.2f}", rsc_in_range),
    "beats uniform": ("an adaptive RSC is better than the best uniform one", better_than_uniform),
    "beats low, high": ("an adaptive RSC is better than a low and than a high uniform one", better_than_low_and_high),
}


def nearer_than_linear(row: Row) -> bool:
    """Whether springs with rest length beat the linear ones by more than counts as the same."""
    return bool(row["linear_mm"] > (1 + SAME) * row["error_mm"])


def by_reading(rows: Sequence[Row], parts: tuple[str, ...] = PARTS) -> dict[tuple[str, ...], list[Row]]:
    """The rows of each reading, one a Poisson's ratio."""
    readings: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        readings.setdefault(tuple(row[part] for part in parts), []).append(row)
    return readings


def verdicts(tables: Tables) -> list[Verdict]:
    """Of the claims that every reading is asked for."""
    rows = tables["readings"]
    found = [_verdict(claim, rows, (test,)) for claim, test in CLAIMS.values()]
    both = f"{CLAIMS['below 1 mm'][0]} with a best RSC0 between {max(MARKS):.2f} and {min(MARKS):.2f}"
    found += [_verdict(both, rows, (below_limit, rsc_in_range)), _marks(tables)]
    for mesh in ("irregular", "finer"):
        claim = f"the difference stays below 1 mm at 5 mm on the {mesh} mesh too"
        found.append(_verdict(claim, where(tables["mesh_readings"], mesh=mesh), (below_limit,), MESH_PARTS))
    rest = tables["rest_length"]
    found += [_verdict(CLAIMS[name][0], rest, (CLAIMS[name][1],), REST_PARTS) for name in ("below 1 mm", "RSC0")]
    return found


def rest_length_sentence(rows: Sequence[Row]) -> str:
    """How springs with rest length come out beside the linear ones."""
    one = _verdict("", rows, (nearer_than_linear,), REST_PARTS)
    return (
        "That springs with rest length are nearer to finite elements than linear ones, each at its best RSC0, "
        f"{one.held}: {one.numbers}."
    )


def _verdict(claim: str, rows: Sequence[Row], tests: tuple[Test, ...], parts: tuple[str, ...] = PARTS) -> Verdict:
    readings = by_reading(rows, parts)
    single = [all(test(row) for test in tests) for row in rows]
    held = {key: all(test(row) for row in some for test in tests) for key, some in readings.items()}
    springs, ratios = "springs with rest length in " if parts == REST_PARTS else "", len(distinct(rows, "poisson"))
    tried = f"on {springs}{len(readings)} readings of the set-up, each at {ratios} Poisson's ratio{'s' * (ratios > 1)}"
    return Verdict(claim, tried, outcome(list(held.values()), "readings at every ratio"), _under(held, single, parts))


def _under(held: Mapping[tuple[str, ...], bool], single: Sequence[bool], parts: tuple[str, ...]) -> str:
    """How many, by each part of a reading; the readings' names if they are few."""
    words = [f"{sum(single)} of {len(single)} single cases"]
    for k, part in enumerate(parts):
        choices = dict.fromkeys(key[k] for key in held)
        counts = {c: [yes for key, yes in held.items() if key[k] == c] for c in choices}
        words.append(f"by {part} " + ", ".join(f"{c} {sum(each)} of {len(each)}" for c, each in counts.items()))
    yes = [" / ".join(key) for key, good in held.items() if good]
    if 0 < len(yes) <= MOST_NAMED:
        words.append(f"namely {', '.join(yes)}")
    return "; ".join(words)


def _marks(tables: Tables) -> Verdict:
    """Whether the worst node is below the limit at the chapter's own RSC0."""
    rows = tables["marks"]
    keys = ("contact", "support", "law", "rsc")
    held: dict[tuple[str, ...], bool] = {}
    for row in rows:
        key = tuple(str(row[k]) for k in keys)
        held[key] = held.get(key, True) and below_limit(row)
    counts = {
        part: ", ".join(
            f"{c} {sum(good for key, good in held.items() if key[k] == str(c))} of "
            f"{sum(key[k] == str(c) for key in held)}"
            for c in distinct(rows, part)
        )
        for k, part in enumerate(keys)
    }
    numbers = "; ".join(f"by {part.replace('rsc', 'RSC0')} {words}" for part, words in counts.items())
    return Verdict(
        f"the difference stays below 1 mm at 5 mm with RSC0 of {', '.join(f'{m:.2f}' for m in MARKS)}",
        "on each contact, support and law at every Poisson's ratio, worst node",
        outcome(list(held.values())),
        numbers,
    )


def readings_table(rows: Sequence[Row]) -> list[list[object]]:
    """Every reading: its best RSC0 and errors by Poisson's ratio, and at how many ratios it reproduces each claim."""
    found = [dict(zip(PARTS, key, strict=True)) | {"rows": some} for key, some in by_reading(rows).items()]

    def several(form: Callable[[Row], str]) -> Callable[[Row], str]:
        return lambda reading: ", ".join(form(row) for row in reading["rows"])

    def count(test: Test) -> Callable[[Row], str]:
        return lambda reading: f"{sum(map(test, reading['rows']))} of {len(reading['rows'])}"

    ratios = ", ".join(f"{p:g}" for p in distinct(rows, "poisson"))
    return shown(
        found,
        *((part, f"{{{part}}}") for part in PARTS),
        (f"best RSC0 at {ratios}", several(lambda r: f"{r['rsc']:.2g}")),
        ("worst node, mm", several(lambda r: f"{r['worst_mm']:.2f}")),
        ("best uniform / adaptive", several(lambda r: f"{r['uniform_mm'] / r['error_mm']:.2f}")),
        *((head, count(test)) for head, (_, test) in CLAIMS.items()),
    )
