"""One breast through everything: scanned, sampled, pushed; and the same push on the true breast."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from palpate.arrays import AnyArray, Float64, Int32
from palpate.cluster.file_tasks import FileTask
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tetrahedralize import tetrahedralize
from palpate.reconstruction.posterior import Posterior, posterior
from palpate.report.stages import Progress, Stages
from palpate.studies.detection.config import GAP
from palpate.studies.doubt.bodies import Body, random_body
from palpate.studies.doubt.config import BODY, CONTACT, LUMP, POISSON, PUSH, Setting
from palpate.studies.run_store import write_arrays
from palpate.tissue.boundary_conditions import resting_on
from palpate.tissue.lump_detectability import force_map
from palpate.tissue.lump_outline import organ
from palpate.tissue.lump_sampling import lump_uncertainty
from palpate.tissue.lump_uncertainty import LumpUncertainty
from palpate.tissue.named_tissues import tissue_properties
from palpate.tissue.tissue import Tissue
from palpate.volumes.radial_gradient import Ball, ball_near
from palpate.volumes.volume import Labels

Record = dict[str, AnyArray]
TRUTHS = "diameter", "depth", "added", "share"
ITERATIONS, LEVELS = 3, 2  # of each sample: more than two, since what is asked of them is as broad as the lump
FIRST_ORDER = 4  # every so many breasts the contrast's standard deviation is also found to first order


def all_breasts(stages: Stages, setting: Setting, progress: Progress) -> list[Record]:
    """The record of every breast, first those that teach; each its own file, so that an interrupted study goes on."""
    found, count = [], setting.train + setting.judge
    for seed in range(count):
        tell = partial(progress, f"breast {seed + 1} of {count}")
        make = partial(judge_breast, seed, setting, tell)
        found.append(stages(_file(seed), make, write_arrays, read_arrays))
    return found


def breast_tasks(folder: Path, setting: Setting) -> list[FileTask]:
    """Every breast, for workers."""
    count = setting.train + setting.judge
    return [FileTask(folder / _file(seed), partial(_write_breast, seed, setting)) for seed in range(count)]


def _write_breast(seed: int, setting: Setting, path: Path) -> None:
    write_arrays(path, judge_breast(seed, setting, lambda share: None))


def _file(seed: int) -> str:
    return f"runs/breast-{seed}.npz"


def read_arrays(path: Path) -> Record:
    """What `write_arrays` wrote."""
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def judge_breast(seed: int, setting: Setting, tell: Callable[[float], None]) -> Record:
    """The truth and the samples of each quantity, by "true|quantity" and "samples|quantity"; tell: the share done.

    And "miss", mm across between the lump and where it was found; "young", kPa; of some "contrast_std", to first order.
    """
    with threadpool_limits(1, user_api="blas"):  # whose rounding depends on the number of threads
        body = random_body(seed, setting)
        found = sampled(body, seed, setting)
        doubt, ball = samples_of(found, body.mark, seed, setting)
        tell(0.7)
        plain, with_lump = true_forces(body, doubt.point, setting)
    truth = {
        "diameter": body.diameter,
        "depth": float((doubt.point - body.centre) @ doubt.normal),
        "added": with_lump - plain,
        "share": with_lump / plain - 1,
    }
    tell(1.0)
    return {
        **{f"true|{name}": np.array(truth[name]) for name in TRUTHS},
        **{f"samples|{name}": doubt.values(name) for name in (*TRUTHS, "contrast")},
        "miss": np.array(np.hypot(*(body.centre - ball.centre)[:2])),
        "young": np.array(body.young),
        **({"contrast_std": np.array(found.linear_std(doubt.weights))} if seed % FIRST_ORDER == 0 else {}),
    }


def sampled(body: Body, seed: int, setting: Setting) -> Posterior:
    """The posterior of a body's scan, with a prior whose strength the data choose."""
    return posterior(
        body.scan,
        setting.grid,
        samples=setting.samples,
        seed=seed,
        sample_iterations=ITERATIONS,
        levels=LEVELS,
    )


def samples_of(
    found: Posterior, mark: Float64, seed: int, setting: Setting, offsets: Float64 | None = None
) -> tuple[LumpUncertainty, Ball]:
    """What the scan alone says, and the lump as found in the MAP estimate near a mark (x, y), mm.

    offsets: (P, 3) mm of the force map's places from where the hand pushes.
    """
    inside = organ(found.map)
    top = GAP + setting.kind.thick
    ball = ball_near(found.map, (*mark, top - setting.kind.thick / 2), inside=inside)
    labels = Labels(inside.astype(np.int32), found.map.grid, {1: "breast"})
    finer = {setting.lump_edge: _points_in(ball)}
    mesh = tetrahedralize(labels, "breast", setting.edge, finer_at=finer, closed_at_border=True, finer_where_thin=False)
    soft = tissue_properties(BODY).required("young")
    tissue = Tissue(mesh, soft, POISSON, held(mesh))
    stiff, body_young = (tissue_properties(name).young for name in (LUMP, BODY))
    assert stiff is not None
    assert body_young is not None
    point = np.array([*ball.centre[:2], mesh.nodes[:, 2].max()])
    doubt = lump_uncertainty(
        found,
        tissue,
        lump=stiff,
        body=body_young,
        near=ball.centre,
        point=point,
        push=PUSH,
        radius=CONTACT,
        places=None if offsets is None else point + offsets,
        seed=seed,
    )
    return doubt, ball


def true_forces(body: Body, point: Float64, setting: Setting) -> tuple[float, float]:
    """N of the push without the lump and with it, on a mesh of the true labels that follows the lump's surface."""
    inside = body.breast.tissue > 0.5
    values = np.where(inside, 1, 0) + (inside & (body.shares > 0.5))
    labels = Labels(values.astype(np.int32), body.breast.grid, {1: "breast", 2: "lump"})
    fine: dict[int | str, float] = {"lump": min(body.diameter / 2 / setting.true_fine, setting.true_edge)}
    mesh = tetrahedralize(
        labels,
        "breast",
        setting.true_edge,
        inclusions=["lump"],
        fine=fine,
        closed_at_border=True,
        finer_where_thin=False,
    )
    forces = []
    for lump in (body.young[1], body.young[0]):
        tissue = Tissue(mesh, {"breast": body.young[1], "lump": lump}, POISSON, held(mesh))
        forces.append(float(force_map(tissue, PUSH, CONTACT, point[None])[0]))
    return forces[0], forces[1]


def held(mesh: TetMesh) -> Int32:
    """Nodes on the lower plate and at the chest wall."""
    plate, wall = (resting_on(mesh, way, depth=1.0) for way in ((0, 0, -1), (0, -1, 0)))
    return np.asarray(np.union1d(plate, wall), np.int32)


def _points_in(ball: Ball) -> Float64:
    """(7, 3) mm: the centre, and 0.6 radii from it along each axis."""
    steps = np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    return np.asarray(np.asarray(ball.centre) + 0.6 * ball.radius * steps)
