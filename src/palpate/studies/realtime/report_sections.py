"""The report's sections: what is promised with its verdict, then the tables of chapter 3."""

import os
import platform
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from palpate import _core
from palpate.report.html_report import Section
from palpate.report.plot_axes import canvas, finish
from palpate.report.tables import Row, distinct, shown, where
from palpate.studies.realtime.config import DEPTH, HAND, SPEED
from palpate.volumes.notebook_figure import COLOURS

Tables = Mapping[str, Sequence[Row]]
BUDGET, FRAMES, MEDIAN, LATEST, LATE = 0.5, 30.0, 50.0, 100.0, 1e-3  # ms, a second, ms, ms, share
NODES = 20_000
NONE, BEYOND = "–", "over 10"
MODEL = (("kidney", "{resolution}"), ("model", "{model}"))  # the first columns of most tables


def sections(tables: Tables) -> list[Section]:
    """All of them."""
    return [
        promises(tables),
        _set_up(tables),
        _ticks(tables),
        _loops(tables),
        _force(tables),
        _pages(tables),
        _memory(tables),
        Section("Files", ["tables/: every number (CSV). runs/: each experiment (JSON), from which --resume goes on."]),
    ]


def promises(tables: Tables) -> Section:
    """What is promised, what this machine did, and whether that is met."""
    fine = [row for row in tables["loops"] if row["nodes"] >= 0.9 * NODES]
    rows = [["promise", "here", "verdict"]]
    for row in fine:
        work = row["work_p99.9_ms"]
        here = f"{row['model']}, {row['nodes']} nodes: {_ms(work, missing=BEYOND)} ms, of processor "
        here += f"{_ms(row['processor_p99.9_ms'], missing=BEYOND)} ms"
        rows.append([f"p99.9 of the loop's work below {BUDGET} ms at 20k nodes", here, _met(_below(work, BUDGET))])
        beyond = row["late"] - row["empty_late"]
        rows.append(
            [f"late ticks below {LATE:.1%} beyond the machine's", f"{row['model']}: {beyond:+.2%}", _met(beyond < LATE)]
        )
    for row in tables["pages"]:
        if "missing" in row:
            continue
        drawn = f"{row['resolution']}, {row['mode']}, {row['rendering']}"
        here = f"{drawn}: {row['pictures_a_second']:.0f} a second"
        rows.append([f"{FRAMES:.0f} frames a second", here, _met(row["pictures_a_second"] >= FRAMES)])
        good = _below(row["delay_p50_ms"], MEDIAN) and _below(row["delay_p99_ms"], LATEST)
        here = f"{drawn}: {_ms(row['delay_p50_ms'], 0)} and {_ms(row['delay_p99_ms'], 0)} ms"
        rows.append([f"hand to picture below {MEDIAN:.0f} ms median, {LATEST:.0f} ms p99", here, _met(good)])
    text = [
        "The dissertation asked for 30 frames a second and a latency below 100 ms; the field for 1000 ticks a second."
    ]
    if len(rows) == 1:
        return Section("Promises", [*text, "No mesh of 20,000 nodes and no browser in this run: nothing to judge."])
    return Section("Promises", text, rows)


def _set_up(tables: Tables) -> Section:
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    return Section(
        "Set-up",
        [
            f"{_processor()}, {os.cpu_count()} processors, {_core.base.instruction_set()}, {platform.system()}; load when "
            f"this report was written: {load:.1f} (all times are wall time, so what else runs is in them).",
            f"The left kidney of the sample CT, its rear held. A finger presses {DEPTH:g} mm into its front and slides "
            f"to and fro at {1000 * SPEED:g} mm/s. Models sweep as often in a tick as a session would let them.",
        ],
        shown(
            {row["resolution"]: row for row in tables["ticks"]}.values(),
            ("kidney", "{resolution}"),
            ("edge, mm", "{edge_mm:g}"),
            ("nodes", "{nodes}"),
            ("tetrahedra", "{tets}"),
            ("triangles shown", "{triangles}"),
        ),
    )


def _ticks(tables: Tables) -> Section:
    table = shown(
        tables["ticks"],
        *MODEL,
        ("sweeps a tick", "{sweeps}"),
        ("p50, ms", "{p50_ms:.3f}"),
        ("p99, ms", "{p99_ms:.3f}"),
        ("p99.9, ms", lambda r: _ms(r["p99.9_ms"], 3)),
        ("without tables", "{cold_share:.1%}"),
    )
    text = [
        "Contact and deformation in one tick, 1000 times a second by the clock. Without tables: the share of ticks that "
        "the model `compliance` answered before its tables were made; they are counted in."
    ]
    figure = _bars(tables["ticks"], "p99_ms", "99 % of the ticks take at most, ms")
    return Section("Time of a deformation", text, table, [(figure, "Log scale.")])


def _loops(tables: Tables) -> Section:
    table = shown(
        tables["loops"],
        *MODEL,
        ("ticks a second", "{ticks_a_second:.1f}"),
        ("work p50, p99, p99.9, ms", lambda r: _three(r, "work")),
        ("of processor", lambda r: _three(r, "processor")),
        ("woken late by", lambda r: _three(r, "woken")),
        ("empty thread", lambda r: _three(r, "empty_woken")),
        ("late ticks", "{late:.2%}"),
        ("empty thread", "{empty_late:.2%}"),
    )
    text = [
        f"The real loop under a hand that moves every {HAND} ms, and beside it, in the same seconds, a thread that only "
        f"waits for the same deadlines. A tick is late when it ends after the next one's deadline; what the empty thread "
        f"is late, no program on this machine could help. Tallies have steps of 0.01 ms and end at 10 ms."
    ]
    return Section("Rate of the loop", text, table)


def _force(tables: Tables) -> Section:
    table = shown(
        tables["loops"],
        *MODEL,
        ("mean force, N", lambda r: _ms(r["mean_force_n"], 3)),
        ("largest step between two ticks", lambda r: NONE if r["largest_step"] is None else f"{r['largest_step']:.2%}"),
    )
    text = [
        "Steps are shares of the mean force. They are taken over all ticks of the slide after the press has come on, from "
        "the exact replay of the run above. Models that came to have tables on the way are included."
    ]
    return Section("Continuity of the force while sliding", text, table)


def _pages(tables: Tables) -> Section:
    missing = [row["missing"] for row in tables["pages"] if "missing" in row]
    if missing:
        return Section("Frames and latency", [f"Not measured: {missing[0]}."])
    table = shown(
        tables["pages"],
        ("kidney", "{resolution}"),
        ("triangles", "{triangles}"),
        ("drawn as", "{mode}"),
        ("by", "{rendering}"),
        ("pictures a second", "{pictures_a_second:.0f}"),
        ("gap p99, ms", lambda r: _ms(r["gap_p99_ms"], 0)),
        ("hand to picture p50, ms", lambda r: _ms(r["delay_p50_ms"], 0)),
        ("p99, ms", lambda r: _ms(r["delay_p99_ms"], 0)),
        ("events", "{delays}"),
    )
    drawn = ", ".join(distinct(tables["pages"], "renderer"))
    text = [
        f"Chromium without a screen, 1280 x 800 pixels, drawn by {drawn}; the loop runs `compliance` on the same machine. "
        "Hand to picture: from a pointer event to the first picture of a frame that obeys it, without a monitor's delay."
    ]
    hardware = any(row["rendering"] == "hardware" for row in tables["pages"])
    text += [] if hardware else ["No graphics card was found here, so drawing by hardware is not measured."]
    figure, (axes,) = canvas(1)
    for k, mode in enumerate(distinct(tables["pages"], "mode")):
        mine = where(tables["pages"], mode=mode, rendering="software")
        at = [i + 0.25 * (k - 1) for i in range(len(mine))]
        axes.bar(at, [r["pictures_a_second"] for r in mine], 0.22, label=mode, color=COLOURS[k])
        axes.set_xticks(range(len(mine)), [r["resolution"] for r in mine])
    axes.axhline(FRAMES, color="#5b6775", lw=1, ls="--")
    axes.legend(frameon=False, fontsize=8)
    finish(axes, "", "kidney", "pictures a second, by software")
    return Section("Frames and latency", text, table, [(figure, f"Dashed: {FRAMES:.0f}.")])


def _memory(tables: Tables) -> Section:
    table = shown(
        tables["memory"],
        *MODEL,
        ("before, MB", lambda r: _ms(r["before_mb"], 0)),
        ("model and session add, MB", lambda r: _ms(r["model_mb"], 0)),
    )
    text = [
        "Resident memory of a process of its own: with libraries and the tissue, and after a session's first 200 ticks."
    ]
    return Section("Memory", text, table)


def _bars(rows: Sequence[Row], value: str, label: str) -> Figure:
    figure, (axes,) = canvas(1)
    kidneys = distinct(rows, "resolution")
    names = distinct(rows, "model")
    for k, name in enumerate(names):
        mine = where(rows, model=name)
        at = [kidneys.index(r["resolution"]) + 0.15 * (k - (len(names) - 1) / 2) for r in mine]
        axes.bar(at, [r[value] for r in mine], 0.13, label=name, color=COLOURS[k % len(COLOURS)])
    axes.set_yscale("log")
    axes.axhline(1.0, color="#5b6775", lw=1, ls="--")
    axes.set_xticks(range(len(kidneys)), kidneys)
    axes.legend(frameon=False, fontsize=8)
    finish(axes, "", "kidney", label)
    return figure


def _three(row: Row, what: str) -> str:
    return ", ".join(_ms(row[f"{what}_p{q}_ms"], missing=BEYOND) for q in ("50", "99", "99.9"))


def _ms(value: float | None, digits: int = 2, missing: str = NONE) -> str:
    return missing if value is None else f"{value:.{digits}f}"


def _below(value: float | None, most: float) -> bool:
    return value is not None and value < most


def _met(good: bool) -> str:
    return "met" if good else "not met"


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    found = re.search(r"model name\s*:\s*(.+)", info.read_text()) if info.exists() else None
    return found[1].strip() if found else platform.processor() or "unknown processor"
