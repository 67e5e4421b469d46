"""The experiments on disk: each made once, kept as it ends, so that an interrupted study goes on."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from palpate.report.stages import Progress, Stages
from palpate.report.tables import Row
from palpate.studies.deformation import (
    accuracy_cost,
    convergence,
    haptic_fidelity,
    kidney,
    large_strain,
    readings,
    rest_length,
    row_table,
    spring_laws,
)
from palpate.studies.deformation.config import CONTACTS, SUPPORTS, Setting
from palpate.studies.deformation.spring_laws import Field
from palpate.studies.run_store import read_json, write_arrays, write_json

Tables = dict[str, list[Row]]
Fields = dict[float, dict[str, Field]]
MIDDLE = 0.3  # Poisson's ratio where one stands for all


def experiments(
    setting: Setting, true: Callable[[], Fields], so_far: Tables
) -> Iterator[tuple[str, Callable[[], Tables]]]:
    """Name and work of each, in order. so_far: the tables of those before."""
    for support in SUPPORTS:
        yield f"readings-{support.replace(' ', '-')}", lambda s=support: readings.readings(setting, s)  # type: ignore[misc]
    yield "laws", lambda: spring_laws.sweep(setting, true())
    yield "profiles", lambda: spring_laws.profiles(setting, true(), so_far["optimum"])
    yield "meshes", lambda: spring_laws.meshes(setting, true(), so_far["optimum"], MIDDLE)
    yield "stiffness", lambda: spring_laws.stiffness(setting, (MIDDLE, setting.ratios[-1]))
    yield "rest-length", lambda: rest_length.judged(setting)
    yield "rows", lambda: row_table.reach(setting)
    for nodes in setting.sizes:
        yield f"convergence-{nodes}", lambda n=nodes: convergence.convergence(setting, n)  # type: ignore[misc]
    for nodes in setting.ladder:
        yield f"pareto-{nodes}", lambda n=nodes: accuracy_cost.front(setting, n)  # type: ignore[misc]
    yield "needed", lambda: accuracy_cost.needed(setting)
    yield "ripple", lambda: haptic_fidelity.ripple(setting)
    yield "loops", lambda: haptic_fidelity.loops(setting)
    yield "strain", lambda: large_strain.large(setting)
    yield "truth-cube", lambda: large_strain.truth_cube(setting)
    yield "kidneys", lambda: kidney.timings(setting)
    yield "kidney-shapes", lambda: kidney.shapes(setting)
    yield "kidney-fit", lambda: kidney.fitted(setting)


def run_all(stages: Stages, setting: Setting, progress: Progress) -> Tables:
    """The tables of all experiments: those of an earlier run are read where `stages` resumes. Raises `FileError`."""
    count = len(setting.ratios) + sum(1 for _ in experiments(setting, dict, {}))
    done = 0
    fields: Fields = {}
    tables: Tables = {}

    def step(name: str) -> None:
        nonlocal done
        progress(f"{done + 1} of {count}: {name}", done / count)
        done += 1

    for poisson in setting.ratios:
        step(f"finite elements, Poisson's ratio {poisson:g}")
        make = lambda p=poisson: spring_laws.truths(setting, p, setting.main, "P2")  # noqa: E731
        fields[poisson] = stages(f"runs/truth-{poisson:g}.npz", make, _write_fields, _read_fields)
    for name, work in experiments(setting, lambda: fields, tables):
        step(name)
        for table, rows in stages(f"runs/{name}.json", work, write_json, read_json).items():
            tables.setdefault(table, []).extend(rows)
    progress(f"{count} experiments", 1.0)
    return tables


def _write_fields(path: Path, fields: dict[str, Field]) -> None:
    write_arrays(path, {f"{name}-{part}": a for name, f in fields.items() for part, a in zip("uf", f, strict=True)})


def _read_fields(path: Path) -> dict[str, Field]:
    with np.load(path) as there:
        return {name: (there[f"{name}-u"], there[f"{name}-f"]) for name in CONTACTS}
