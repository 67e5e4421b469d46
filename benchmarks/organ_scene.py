"""Five organs of a CT in one session, one stroked while it presses on others: ticks by the clock.

    python -m benchmarks.organ_scene

Liver, both kidneys, spleen and stomach of the sample, each of 2,000 nodes or more, held at their backs. A tool holds the
liver beside the stomach, presses 6 mm and strokes to and fro at 50 mm/s for 30 s: once smooth, once with friction.
"""

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.meshes.separate_organs import organs
from palpate.samples import sample
from palpate.simulation.pointer import Command, Pointer
from palpate.simulation.session import Session
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.organ_gaps import organ_gaps

SCENE = """palpate scene: 1
labels: {labels}
organs:
  liver: {{tissue: liver, edge: 9}}
  kidney_right: {{tissue: kidney, edge: 5.5}}
  kidney_left: {{tissue: kidney, edge: 5}}
  spleen: {{tissue: spleen, edge: 6.5}}
  stomach: {{young: 5, edge: 5.2}}
"""
NEAR = 2.0  # mm at rest: organs that are touching
PRESS, SPEED, WAY, SECONDS = 6.0, 50.0, 20.0, 30.0  # mm, mm/s, mm, s
FRICTION = 0.1
STEP = 1e-5  # s, of the loop's tallies


def scene() -> pp.Tissue:
    """The organs."""
    labels = sample("abdomen") / "labels.nii.gz"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(SCENE.format(labels=labels))
        return pp.read_scene(path)


def touching(tissue: pp.Tissue) -> list[str]:
    """Pairs of organs that are less than `NEAR` apart somewhere."""
    found = organ_gaps(tissue.mesh)
    N, rest = found.N, found.rest
    organ = organs(tissue.mesh)
    names = [
        tissue.mesh.names[int(tissue.mesh.region[organ[tissue.mesh.tets[:, 0]] == k][0])]
        for k in range(organ.max() + 1)
    ]
    column = N.tocsc()
    pairs = {
        tuple(np.unique(organ[column.indices[column.indptr[g] : column.indptr[g + 1]] // 3]).tolist())
        for g in np.flatnonzero(rest < NEAR)
    }
    return [" and ".join(names[k] for k in pair) for pair in sorted(pairs)]


def stroke(tissue: pp.Tissue, model: ComplianceModel) -> tuple[Session, float, float]:
    """The session, the largest displacement (mm) of an organ that no tool touches, and the newest force (N)."""
    session, pointer = Session(model, radius=12.0), Pointer()
    found = organ_gaps(tissue.mesh)
    N, rest = found.N, found.rest
    organ = organs(tissue.mesh)
    liver = int(organ[tissue.mesh.tets[np.argmax(tissue.mesh.region == 5), 0]])
    surface = np.unique(tissue.mesh.surface)
    mine = surface[(organ[surface] == liver) & ~tissue.held[surface]]
    near = np.unique(N.tocsc()[:, np.argsort(rest)[:40]].indices // 3)
    others = near[organ[near] != liver]
    start = mine[np.argmin(np.linalg.norm(tissue.mesh.nodes[mine] - tissue.mesh.nodes[others].mean(axis=0), axis=1))]
    front = mine[
        np.argmin(
            tissue.mesh.nodes[mine, 1]
            + np.linalg.norm((tissue.mesh.nodes[mine] - tissue.mesh.nodes[start])[:, ::2], axis=1)
        )
    ]
    at = tissue.mesh.nodes[front]
    moved = 0.0
    session.start(pointer)
    with session:
        began = time.monotonic()
        while (t := time.monotonic() - began) < SECONDS:
            along = WAY / 2 * np.sin(2 * np.pi * SPEED / (2 * WAY) * t)
            point = tissue.surface.closest(at + (along, 0, 0))
            inward = -PRESS * np.array(tissue.surface.normal(point))
            pointer.send(Command(True, tuple(np.array(point.point).tolist()), tuple(inward.tolist())), None, 0)
            time.sleep(1 / 60)
        frame = session.frame()
        drawn = np.linalg.norm(session.drawn(frame), axis=1)
        assert session.displayed.organ is not None
        moved = float(drawn[session.displayed.organ != liver].max())
        force = float(np.linalg.norm(frame.force[0]))
    return session, moved, force


@dataclass(frozen=True)
class Run:
    """One stroke. made: s, of the model. slowest: s, of 99 % of the ticks. moved: mm. force: N at the end."""

    made: float
    gaps: int
    ticks: float
    late: int
    slowest: float
    force: float
    moved: float


def run(tissue: pp.Tissue) -> Run:
    """With a model of its own."""
    began = time.perf_counter()
    model = ComplianceModel(tissue)
    made = time.perf_counter() - began
    session, moved, force = stroke(tissue, model)
    tallies = session.loop.tallies()[0]
    slowest = STEP * float(np.searchsorted(np.cumsum(tallies), 0.99 * tallies.sum()) + 1)
    frame = session.frame()
    assert model.gaps is not None
    return Run(made, len(model.gaps.rest), frame.tick / SECONDS, frame.late, slowest, force, moved)


def main() -> None:
    """Prints the figures and writes them into the documentation."""
    began = time.perf_counter()
    tissue = scene()
    meshed = time.perf_counter() - began
    counts = np.bincount(organs(tissue.mesh))
    smooth, rough = (run(tissue.replace(surface_friction=friction)) for friction in (0.0, FRICTION))
    both = [
        ("gaps", "{0.gaps:,} | {1.gaps:,}"),
        ("model made", "{0.made:.1f} s | {1.made:.1f} s"),
        ("ticks a second", "{0.ticks:,.0f} | {1.ticks:,.0f}"),
        ("of them late", "{0.late} | {1.late}"),
        ("force at the end", "{0.force:.2f} N | {1.force:.2f} N"),
        ("an organ that no tool touches moves by", "{0.moved:.1f} mm | {1.moved:.1f} mm"),
    ]
    lines = [
        f"{', '.join(f'{n:,}' for n in counts)} nodes, {counts.sum():,} in all, meshed and joined in {meshed:.1f} s. Pairs "
        f"of organs less than {NEAR:g} mm apart: {'; '.join(touching(tissue))}.",
        "",
        f"| quantity | smooth | friction {FRICTION:g} |",
        "|---|---|---|",
        *(f"| {name} | {text.format(smooth, rough)} |" for name, text in both),
        f"| tick, 99 % | {1e6 * smooth.slowest:.0f} µs | {1e6 * rough.slowest:.0f} µs |",
    ]
    head = (
        f"`python -m benchmarks.organ_scene`: a press of {PRESS:g} mm on the liver that strokes at {SPEED:g} mm/s "
        f"for {SECONDS:g} s"
    )
    print("\n".join(lines))
    (Path(__file__).parents[1] / "docs" / "figures" / "organ-scene.md").write_text(
        f"{head}\n\n" + "\n".join(lines) + "\n"
    )


if __name__ == "__main__":
    main()
