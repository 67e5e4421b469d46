"""MuJoCo's flex: Saint Venant-Kirchhoff tetrahedra; by its integrator `discrete`, implicit in their stiffness.

A flex takes no bodies that are moved from outside: the touched nodes are a million times heavier and put back after each
step. SI units.
"""

import time
from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np

from benchmarks.cube_case import GREEN, POISSON, YOUNG, Cube
from benchmarks.settling_time import Run

NAME, MATERIAL = "MuJoCo flex", "St. Venant-Kirchhoff"
MISSING = "MuJoCo flex is left out: pip install mujoco"
LAW, EXACT = GREEN, False
CHOICES = ((0.02, True), (0.05, True), (0.005, False))  # step s, velocities set to zero
HEAVY = 1e6


def there() -> bool:
    return find_spec("mujoco") is not None


def runs(cube: Cube) -> Iterator[Run]:
    """Each choice from the start."""
    for seconds, quiet in CHOICES:
        yield _run(cube, seconds, quiet)


def _run(cube: Cube, seconds: float, quiet: bool) -> Run:
    import mujoco

    mujoco.set_mju_user_warning(lambda text: None)  # else a log is left in the folder
    began = time.process_time()
    model = mujoco.MjModel.from_xml_string(scene(cube, seconds))
    data = mujoco.MjData(model)
    setup = time.process_time() - began
    free = np.cumsum(~cube.tissue.held) - 1
    given = (3 * free[cube.touched][:, None] + np.arange(3)).ravel()
    goal = 1e-3 * cube.truth[cube.touched].ravel()

    def put() -> None:
        if quiet:
            data.qvel[:] = 0
        data.qpos[given], data.qvel[given] = goal, 0

    put()

    def place() -> np.ndarray:
        u = np.zeros_like(cube.truth)
        u[~cube.tissue.held] = 1e3 * data.qpos.reshape(-1, 3)
        return u

    settings = f"{1e3 * seconds:g} ms, damping 0.01 s" + (", velocities zeroed" if quiet else "")
    return Run(settings, setup, lambda: mujoco.mj_step(model, data), place, put)


def scene(cube: Cube, seconds: float) -> str:
    """MuJoCo's XML: a body with three slides for each node that is not held."""
    mesh, held, touched = cube.tissue.mesh, cube.tissue.held, set(cube.touched.tolist())
    x = 1e-3 * mesh.nodes

    def text(values: np.ndarray) -> str:
        return " ".join(f"{v:.12g}" for v in np.ravel(values))

    slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    bodies = []
    for i in np.flatnonzero(~held).tolist():
        mass = float(cube.mass[i]) * (HEAVY if i in touched else 1)
        inertia = text(np.full(3, 1e-6 * mass))
        bodies.append(
            f'<body name="v{i}" pos="{text(x[i])}"><inertial pos="0 0 0" mass="{mass!r}" diaginertia="{inertia}"/>'
            f"{slides}</body>"
        )
    names = " ".join("world" if held[i] else f"v{i}" for i in range(len(x)))
    return (
        f'<mujoco><option timestep="{seconds}" gravity="0 0 0" integrator="discrete"><flag contact="disable"/></option>'
        f"<worldbody>{''.join(bodies)}</worldbody><deformable>"
        f'<flex name="cube" dim="3" radius="1e-4" body="{names}" vertex="{text(np.where(held[:, None], x, 0))}" '
        f'element="{text(mesh.tets)}"><contact contype="0" conaffinity="0" selfcollide="none"/>'
        f'<elasticity young="{1e3 * YOUNG}" poisson="{POISSON}" damping="0.01"/></flex></deformable></mujoco>'
    )
