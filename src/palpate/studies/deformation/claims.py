"""The dissertation's claims and ours, each with what the numbers say of it, whatever they turn out to be."""

from collections.abc import Mapping, Sequence

import numpy as np

from palpate.report.tables import Row, distinct, where
from palpate.studies.deformation import reading_claims
from palpate.studies.deformation.haptic_fidelity import peak_to_peak
from palpate.studies.verdict import Verdict, outcome

Tables = Mapping[str, list[Row]]


def claims(tables: Tables) -> list[Verdict]:
    """The chapter's, over all readings of its set-up where they depend on it."""
    found = [*reading_claims.verdicts(tables), *_larger_pushes(tables), *_reach(tables)]
    return [*found, *_sweeps(tables), _stability(tables), _frames(tables)]


def own_claims(tables: Tables) -> list[list[str]]:
    """What palpate promises beyond the chapter."""
    return [["promise", "verdict", "here"], *_ripple(tables), *_loops(tables)]


def _larger_pushes(tables: Tables) -> list[Verdict]:
    claim = "the relative difference at 10 mm is that at 5 mm"
    share = [20 * r["worst_mm"] for r in tables["readings"]]
    linear = f"both are linear, so it must: {min(share):.0f} to {max(share):.0f} % of the push at any depth, worst node"
    found = [Verdict(claim, "against linear elements on every reading", "holds by construction", linear)]
    at = {r["depth_mm"]: 100 * r["worst_mm"] / r["depth_mm"] for r in where(tables["large"], model="springs")}
    if at:
        depths = sorted(at)
        words = ", ".join(f"{at[d]:.0f} % at {d:g} mm" for d in depths)
        held = outcome([abs(at[depths[1]] / at[depths[0]] - 1) < 0.1])
        found.append(Verdict(claim, "against finite strain under the smooth patch, within a tenth", held, words))
    return found


def _reach(tables: Tables) -> list[Verdict]:
    """Of the deformed-node index table."""
    rows = tables["reach"]
    cases = [where(rows, nodes=n, still_mm=s) for n in distinct(rows, "nodes") for s in distinct(rows, "still_mm")]
    tried = f"on {len(distinct(rows, 'nodes'))} cubes with {len(distinct(rows, 'still_mm'))} thresholds"
    counts = [[r["nodes_in_table"] for r in sorted(some, key=lambda r: float(r["depth_mm"]))] for some in cases]
    further = [few == sorted(few) and few[0] < few[-1] for few in counts]
    words = "; ".join(
        f"{some[0]['nodes']}³ at {some[0]['still_mm']:g} mm "
        + ", ".join(f"{r['nodes_in_table']} ({r['depth_mm']:g} mm)" for r in some)
        for some in cases
    )
    claim = "a small displacement moves few nodes and a larger one reaches further"
    found = [Verdict(claim, f"{tried} by the deformed-node index table", outcome(further), f"nodes moved {words}")]
    gain = [r["whole_s"] / r["s"] for r in rows]
    numbers = f"the time of all nodes is {min(gain):.1f} to {max(gain):.1f} times that of the table"
    claim = "the deformed-node index table saves time"
    tried = f"{tried} at {len(distinct(rows, 'depth_mm'))} pushes, against all nodes by the same rule"
    return [*found, Verdict(claim, tried, outcome([g > 1 for g in gain]), numbers)]


def reached(rows: Sequence[Row], error: float) -> int | None:
    """Sweeps until the true error is no more than `error` of the push, and stays so."""
    late = [i for i, r in enumerate(rows) if r["error"] > error]
    first = late[-1] + 1 if late else 0
    return int(rows[first]["sweeps"]) if first < len(rows) else None


def _sweeps(tables: Tables) -> list[Verdict]:
    found = []
    for name in distinct(tables["convergence"], "model"):
        sizes = distinct(where(tables["convergence"], model=name), "nodes")
        counts = {n: reached(where(tables["convergence"], model=name, nodes=n), 0.01) for n in sizes}
        words = ", ".join(f"{n}³ {c if c is not None else 'not in 512'}" for n, c in counts.items())
        held = outcome([c is not None for c in counts.values()])
        tried = f"with {name} on {len(sizes)} cubes from rest"
        found.append(Verdict("the sweeps converge", tried, held, f"sweeps to 1 % of the push {words}"))
    return found


def _stability(tables: Tables) -> Verdict:
    some = tables["stability"]
    calm = [r["shaken_mm"] < 3 * r["shake_mm"] and r["after_1024_mm"] < 0.05 for r in some]
    home, most = max(r["after_1024_mm"] for r in some), max(r["shaken_mm"] for r in some)
    words = f"they come home to {home:.1g} mm, and no node moves by more than {most:.0f} mm under the jumps"
    tried = "with nodes thrown about by 100 mm and 1024 sweeps, and a tool that jumps by 15 mm every tick"
    return Verdict("the sweeps are stable, whatever the hand does", tried, outcome(calm), words)


def _frames(tables: Tables) -> Verdict:
    some = where(tables["kidneys"], model="springs")
    words = ", ".join(
        f"{r['resolution']} {1e3 * r['push_s_0.01']:.2g} ms pushed and {1e3 * r['pull_s_0.01']:.2g} ms pulled"
        for r in some
    )
    held = outcome([max(r["push_s_0.01"], r["pull_s_0.01"]) < 1 / 30 for r in some])
    claim = "a kidney at every resolution is deformed 30 times a second"
    return Verdict(claim, "with springs to 1 %, each push and pull from rest", held, words)


def _ripple(tables: Tables) -> list[list[str]]:
    lines = []
    for radius in distinct(tables["ripple"], "radius_edges"):
        some = where(tables["ripple"], radius_edges=radius)
        peaks = {
            m: peak_to_peak(np.array([r["force_n"] for r in where(some, model=m)])) for m in distinct(some, "model")
        }
        words = ", ".join(f"{name} {100 * peak:.2f} %" for name, peak in peaks.items())
        highest = max(peaks.values())
        held = "at most 1 %" if highest <= 0.01 else "at most 3 %" if highest <= 0.03 else "above 3 %"
        lines.append([f"stiffness ripple of a patch of {radius:g} edges ({some[0]['radius_mm']:g} mm)", held, words])
    return lines


def _loops(tables: Tables) -> list[list[str]]:
    lines = []
    for path in distinct(tables["loops"], "path"):
        some = where(tables["loops"], path=path)
        shares = {r["model"] + ", " + r["how"]: r["net_nmm"] / r["stored_nmm"] for r in some}
        worst = min(shares, key=shares.__getitem__)
        words = f"least net work {100 * shares[worst] + 0.0:.2g} % of the most stored ({worst})"
        held = outcome([s >= -0.01 for s in shares.values()])
        lines.append([f"returns no net work (within 1 % of the stored energy): {path}", held, words])
    return lines
