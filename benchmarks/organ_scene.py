"""Five organs of a CT in one session, one stroked while it presses on others: ticks by the clock.

    python -m benchmarks.organ_scene

Liver, both kidneys, spleen and stomach of the sample, each of 2,000 nodes or more, held at their backs. A tool holds the
liver beside the stomach, presses 6 mm and strokes to and fro at 50 mm/s for 30 s.
"""

import tempfile
import time
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


def main() -> None:
    """Prints the figures and writes them into the documentation."""
    began = time.perf_counter()
    tissue = scene()
    meshed = time.perf_counter() - began
    began = time.perf_counter()
    model = ComplianceModel(tissue)
    made = time.perf_counter() - began
    counts = np.bincount(organs(tissue.mesh))
    session, moved, force = stroke(tissue, model)
    tallies = session.loop.tallies()[0]
    slowest = STEP * float(np.searchsorted(np.cumsum(tallies), 0.99 * tallies.sum()) + 1)
    frame = session.frame()
    assert model.gaps is not None
    lines = [
        "| quantity | |",
        "|---|---|",
        f"| nodes | {', '.join(f'{n:,}' for n in counts)}: {counts.sum():,} |",
        f"| pairs of organs less than {NEAR:g} mm apart | {'; '.join(touching(tissue))} |",
        f"| gaps | {len(model.gaps.rest):,} |",
        f"| meshed and joined | {meshed:.1f} s |",
        f"| model made | {made:.1f} s |",
        f"| ticks a second | {frame.tick / SECONDS:,.0f} |",
        f"| of them late | {frame.late} |",
        f"| tick, 99 % | {1e6 * slowest:.0f} µs |",
        f"| force at the end | {force:.2f} N |",
        f"| an organ that no tool touches moves by | {moved:.1f} mm |",
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
