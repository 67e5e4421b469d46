"""The dissertation's claims and ours, each with what the numbers say of it, whatever they turn out to be."""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from palpate.report.tables import Row, distinct, where
from palpate.studies.deformation.config import MARKS, Setting
from palpate.studies.deformation.haptic_fidelity import peak_to_peak

Tables = Mapping[str, list[Row]]
LIMIT = 1.0  # mm, the dissertation's at 5 mm
SAME = 0.05  # share by which one law must be better to count so


def claims(tables: Tables, setting: Setting) -> list[list[str]]:
    """Claim, verdict, numbers."""
    rows = [["claim", "verdict", "here"], *_below_a_millimetre(tables, setting), *_larger_pushes(tables)]
    return [*rows, _adaptive(tables), _marks(tables), *_meshes(tables), *_sweeps(tables), _frames(tables)]


def own_claims(tables: Tables) -> list[list[str]]:
    """What palpate promises beyond the chapter."""
    return [["promise", "verdict", "here"], *_ripple(tables), *_loops(tables)]


def verdict(each: Sequence[bool]) -> str:
    """Of many cases."""
    if all(each):
        return "holds"
    return f"holds in {sum(each)} of {len(each)} cases" if any(each) else "does not hold"


def _best(tables: Tables, contact: str, weights: str, law: str = "exponential", least: str = "worst_mm") -> list[Row]:
    return where(tables["optimum"], contact=contact, weights=weights, law=law, least=least)


def _list(rows: Sequence[Row], column: str, form: str = ".2f", by: str = "poisson") -> str:
    return ", ".join(f"{row[column]:{form}} ({row[by]:g})" for row in rows)


def _below_a_millimetre(tables: Tables, setting: Setting) -> list[list[str]]:
    lines = []
    for contact, words in (("triangle", "its own contact"), ("patch", f"a smooth patch of {setting.radius:g} mm")):
        for weights in ("equal", "cotangent"):
            some = _best(tables, contact, weights)
            claim = f"exponential RSC: below 1 mm at 5 mm ({words}, {weights} edges, best RSC0)"
            held = verdict([r["worst_mm"] < LIMIT for r in some])
            lines.append([claim, held, f"worst node, mm (Poisson's ratio): {_list(some, 'worst_mm')}"])
    for mark in MARKS:
        some = [r for w in ("equal", "cotangent") for r in _best(tables, "triangle", w, least=f"mark {mark:g}")]
        worst = [r["worst_mm"] for r in some]
        words = f"{min(worst):.2f} to {max(worst):.2f} mm over both edges and all ratios"
        lines.append([f"the same at RSC0 {mark:g} (its own contact)", verdict([w < LIMIT for w in worst]), words])
    return lines


def _larger_pushes(tables: Tables) -> list[list[str]]:
    share = [100 * r["worst_share"] for r in _best(tables, "triangle", "equal")]
    words = (
        f"against linear elements it must, since both are linear: {min(share):.0f} to {max(share):.0f} % of the push at any "
        "depth"
    )
    lines = [["the relative difference at 10 mm is that at 5 mm", "holds, by construction", words]]
    some = where(tables["large"], model="springs")
    if some:
        at = {r["depth_mm"]: 100 * r["worst_mm"] / r["depth_mm"] for r in some}
        depths = sorted(at)
        words = ", ".join(f"{at[d]:.0f} % at {d:g} mm" for d in depths)
        held = verdict([abs(at[depths[1]] / at[depths[0]] - 1) < 0.1])
        lines.append(["the same, against finite strain (smooth patch)", held, words])
    return lines


def _adaptive(tables: Tables) -> list[str]:
    gains = []
    for contact, weights, law in product(("triangle", "patch"), ("equal", "cotangent"), ("linear", "exponential")):
        pairs = zip(_best(tables, contact, weights, "uniform"), _best(tables, contact, weights, law), strict=True)
        gains += [u["worst_mm"] / a["worst_mm"] for u, a in pairs]
    words = (
        f"worst error of the best uniform over that of the best adaptive law: {min(gains):.2f} to "
        f"{max(gains):.2f}, mean {np.mean(gains):.2f}"
    )
    return ["adaptive RSC is better than uniform RSC, each at its best", verdict([g > 1 + SAME for g in gains]), words]


def _marks(tables: Tables) -> list[str]:
    some = _best(tables, "triangle", "equal")
    found = ", ".join(f"{-r['rsc']:.3f} ({r['poisson']:g})" for r in some)
    inside = [min(MARKS) <= -r["rsc"] <= max(MARKS) for r in some]
    return [
        "the best RSC0 lies about -0.10 to -0.18, by Poisson's ratio (its own contact, equal edges)",
        verdict(inside),
        f"best RSC0 (ratio): {found}; it falls towards 0 as the ratio grows",
    ]


def _meshes(tables: Tables) -> list[list[str]]:
    lines = []
    for mesh in ("irregular", "finer"):
        some = where(tables["meshes"], mesh=mesh, contact="triangle", weights="equal")
        words = "; ".join(f"{r['choice']} RSC0 {-r['rsc']:.3f}: {r['worst_mm']:.2f} mm" for r in some)
        held = verdict([r["worst_mm"] < LIMIT for r in some])
        lines.append([f"below 1 mm at 5 mm on the {mesh} mesh too (equal edges)", held, words])
    return lines


def reached(rows: Sequence[Row], error: float) -> int | None:
    """Sweeps until the true error is no more than `error` of the push, and stays so."""
    late = [i for i, r in enumerate(rows) if r["error"] > error]
    first = late[-1] + 1 if late else 0
    return int(rows[first]["sweeps"]) if first < len(rows) else None


def _sweeps(tables: Tables) -> list[list[str]]:
    lines = []
    for name in distinct(tables["convergence"], "model"):
        sizes = distinct(where(tables["convergence"], model=name), "nodes")
        counts = {n: reached(where(tables["convergence"], model=name, nodes=n), 0.01) for n in sizes}
        words = ", ".join(f"{n}³: {c if c is not None else 'not in 512'}" for n, c in counts.items())
        held = verdict([c is not None for c in counts.values()])
        lines.append([f"{name}: sweeps converge", held, f"sweeps to 1 % of the push: {words}"])
    some = tables["stability"]
    calm = [r["shaken_mm"] < 3 * r["shake_mm"] and r["after_1024_mm"] < 0.05 for r in some]
    home, most = max(r["after_1024_mm"] for r in some), max(r["shaken_mm"] for r in some)
    words = (
        f"nodes thrown about by 100 mm come home to {home:.1g} mm after 1024 sweeps; a tool that jumps by 15 mm every tick "
        f"moves no node by more than {most:.0f} mm"
    )
    return [*lines, ["sweeps are stable, whatever the hand does", verdict(calm), words]]


def _frames(tables: Tables) -> list[str]:
    some = where(tables["kidneys"], model="springs")
    words = ", ".join(f"{r['resolution']} {1e3 * r['push_s_0.01']:.2g} ms" for r in some)
    held = verdict([r["push_s_0.01"] < 1 / 30 for r in some])
    claim = "kidney at every resolution: 30 deformations a second (springs, to 1 %)"
    return [claim, held, f"one push from rest: {words}"]


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
        held = verdict([s >= -0.01 for s in shares.values()])
        lines.append([f"returns no net work (within 1 % of the stored energy): {path}", held, words])
    return lines
