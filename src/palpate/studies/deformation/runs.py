"""The experiments on disk: each made once, kept as it ends, so that an interrupted study goes on."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from palpate.atomic import replacing
from palpate.studies.deformation import feel, laws, organs, pareto, strain, sweeps
from palpate.studies.deformation.laws import Field
from palpate.studies.deformation.setting import CONTACTS, Setting
from palpate.studies.records import read_json, same_study, write_json
from palpate.studies.stages import Stages
from palpate.studies.tables import Row
from palpate.tissue.models import names

Tables = dict[str, list[Row]]
Fields = dict[float, dict[str, Field]]
MIDDLE = 0.3  # Poisson's ratio where one stands for all


def experiments(
    setting: Setting, true: Callable[[], Fields], so_far: Tables
) -> Iterator[tuple[str, Callable[[], Tables]]]:
    """Name and work of each, in order. so_far: the tables of those before."""
    yield "laws", lambda: laws.sweep(setting, true())
    yield "profiles", lambda: laws.profiles(setting, true(), so_far["optimum"])
    yield "meshes", lambda: laws.meshes(setting, true(), so_far["optimum"], MIDDLE)
    yield "stiffness", lambda: laws.stiffness(setting, (MIDDLE, setting.ratios[-1]))
    for nodes in setting.sizes:
        yield f"convergence-{nodes}", lambda n=nodes: sweeps.convergence(setting, n)  # type: ignore[misc]
    for nodes in setting.ladder:
        yield f"pareto-{nodes}", lambda n=nodes: pareto.front(setting, n)  # type: ignore[misc]
    yield "needed", lambda: pareto.needed(setting)
    yield "ripple", lambda: feel.ripple(setting)
    yield "loops", lambda: feel.loops(setting)
    yield "strain", lambda: strain.large(setting)
    yield "truth-cube", lambda: strain.truth_cube(setting)
    yield "kidneys", lambda: organs.timings(setting)
    yield "kidney-fit", lambda: organs.fitted(setting)


def run_all(stages: Stages, setting: Setting, say: Callable[[str, float], None]) -> Tables:
    """The tables of all experiments: those of an earlier run are read where `stages` resumes. Raises `FileError`."""
    for name in ("runs", "figures", "tables"):
        (stages.folder / name).mkdir(exist_ok=True)
    same_study(stages, f"{setting.name}, models {' '.join(names())}")
    count = len(setting.ratios) + sum(1 for _ in experiments(setting, dict, {}))
    done = 0
    fields: Fields = {}
    tables: Tables = {}

    def step(name: str) -> None:
        nonlocal done
        say(f"{done + 1} of {count}: {name}", done / count)
        done += 1

    for poisson in setting.ratios:
        step(f"finite elements, Poisson's ratio {poisson:g}")
        make = lambda p=poisson: laws.truths(setting, p, setting.main, "P2")  # noqa: E731
        fields[poisson] = stages(f"runs/truth-{poisson:g}.npz", make, _write_fields, _read_fields)
    for name, work in experiments(setting, lambda: fields, tables):
        step(name)
        for table, rows in stages(f"runs/{name}.json", work, write_json, read_json).items():
            tables.setdefault(table, []).extend(rows)
    say(f"{count} experiments", 1.0)
    return tables


def _write_fields(path: Path, fields: dict[str, Field]) -> None:
    arrays = {
        f"{name}-{part}": array for name, field in fields.items() for part, array in zip("uf", field, strict=True)
    }
    with replacing(path) as temporary:
        np.savez(temporary, **arrays)  # type: ignore[arg-type]


def _read_fields(path: Path) -> dict[str, Field]:
    with np.load(path) as there:
        return {name: (there[f"{name}-u"], there[f"{name}-f"]) for name in CONTACTS}
