"""Arrays that the package makes from fixed inputs, to see that a change of names or layout changes no result.

python tests/digest.py -o FILE.npz writes them. python tests/digest.py --compare FILE.npz makes them again and says for
each how far it is from the one in the file. It exits 1 if one is missing or off by more than 1e-5 of its largest value.
--only NAME makes one part alone. Only public names are used; where a name has an old and a new spelling, either will do.

Tissue has P1 elements here, as in version 0.1. Version 0.2 weighs the nodes of a contact by integrals, so all that a push
enters (`CONTACTS`) differs from version 0.1 by intention: it is made and compared, but does not count.
"""

import argparse
import dataclasses
import inspect
import sys
import tempfile
import time
from functools import cache
from pathlib import Path

import numpy as np

import palpate as pp

LIMIT = 1e-5
CONTACTS = ("fits/", "pushes/", "sessions/")
HASHES = "hash/"  # arrays below this name agree only on machines of one instruction set
ROUNDING = 1e-9  # an error of less is that of exact solvers, and no result
ORGAN, LUMP = 3, 200
MODELS = ("springs", "blocks", "multigrid", "compliance", "neo-hookean")


def public(*spellings):
    """The public name that there is of several spellings."""
    for name in spellings:
        if name in pp.__all__:
            return getattr(pp, name)
    raise AttributeError(f"palpate has none of {', '.join(spellings)}")


def two_materials(likelihood):
    """The public function for beams hardened by two materials: the likelihood, or the reconstruction."""
    names = [n for n in pp.__all__ if "two_material" in n and ("likelihood" in n) == likelihood]
    assert len(names) == 1, names
    return getattr(pp, names[0])


def optimiser(name):
    """The keyword of an optimiser as `iterates` spells it today."""
    known = inspect.signature(pp.iterates).parameters
    return {"optimizer" if "optimizer" in known else "optimiser": name}


def prior_of(potential, **options):
    try:
        return pp.Prior(potential, **options)
    except ValueError:
        return pp.Prior(potential.replace("ise", "ize"), **options)


@cache
def body():
    """A body with a ball, a box, a hole and what two solids have in common."""
    common = public("Intersection", "Common")
    cut = common([pp.Ellipsoid((-9, 4, 20), 6), pp.Box((-9, 4, 23), (14, 14, 6))])
    return pp.Phantom(
        [
            (pp.Ellipsoid((0, 0, 20), (18, 13, 8)), 0.02),
            (pp.Ellipsoid((6, 3, 21), 3), 0.03),
            (pp.Box((-3, -6, 19), (4, 3, 5)), -0.015),
            (cut, 0.02),
        ]
    )


@cache
def grid():
    return pp.Grid((10, 20, 24), (2, 1.6, 1.8), (-20.7, -15.2, 11))


@cache
def views_of(name):
    """`flat` has a panel that stays level, `turned` one that turns about y, `tilted` one about no axis of the grid."""
    panel = pp.Panel((30, 38), (1.6, 1.7), (-31.45, -23.2, 0))
    if name == "flat":
        return pp.circular_views(panel, radius=150, height=400, count=6, start=10)
    axis = (0, 1, 0) if name == "turned" else (0.2, 1, 0.1)
    return pp.rotating_views(panel, np.linspace(-35, 35, 6), source=(0, 0, 420), pivot=(0, 0, 20), axis=axis)


@cache
def scan_of(name):
    """Counts with background, dead pixels and noise."""
    views = views_of(name)
    mask = np.random.default_rng(5).random(views.shape) > 0.01
    incident = np.linspace(9000, 11000, len(views))
    return pp.simulate_scan(body(), views, incident, seed=3, background=20, mask=mask)


def views_arrays(views):
    panels = views.panels
    poses = {name: np.array([getattr(p, name) for p in panels]) for name in ("origin", "row_axis", "column_axis")}
    return {"source": views.source, "pitch": np.array([p.pitch for p in panels]), **poses}


def scans():
    """Motions, counts, corrections, samples, the phantom itself."""
    panel, made = pp.Panel((8, 10), (2, 2), (-9, -7, 0)), {}
    motions = {
        "circular": pp.circular_views(panel, radius=100, height=500, count=5, fulcrum=30),
        "linear": pp.linear_views(panel, length=200, height=500, count=5, direction=20),
        "hypocycloid": pp.hypocycloid_views(panel, radius=100, height=500, count=7),
        "arc": pp.arc_views(panel, [-20, 0, 25], radius=400, pivot=(1, 2, 20)),
        "rotating": views_of("tilted"),
        "moved": public("shift_panels", "moved_panels")(views_of("flat"), np.arange(12).reshape(6, 2) / 10),
    }
    for motion, views in motions.items():
        made.update({f"{motion}/{name}": values for name, values in views_arrays(views).items()})
    for name in ("flat", "turned"):
        scan = scan_of(name)
        made[f"{name}/counts"], made[f"{name}/incident"], made[f"{name}/mask"] = scan.counts, scan.incident, scan.mask
        made[f"{name}/line integrals"] = pp.line_integrals(scan)
        made[f"{name}/open beam"] = pp.open_beam(scan.counts, scan.mask)
        made[f"{name}/equal contrast"] = pp.equal_contrast(scan.counts, scan.incident[:, 0, 0], scan.mask)
    scan = scan_of("flat")
    read = pp.integrating_scan(2 * scan.counts, 2 * scan.incident, scan.views, gain=2.0, electronic=9.0)
    made["integrating/counts"], made["integrating/background"] = read.counts, read.background
    for name in ("breast", "head"):
        sample = pp.import_scan(name)
        made[f"{name}/counts"] = sample.counts[::2, 5::40, 5::40]
        made[f"{name}/source"] = sample.views.source
    return {**made, "truth": body().volume(grid()).values}


def projectors():
    """Forward and back, for panels that are level, turned and tilted."""
    rng, made = np.random.default_rng(1), {}
    x = rng.random(grid().shape, np.float32)
    for name in ("flat", "turned", "tilted"):
        views = views_of(name)
        A = pp.Projector(views, grid())
        p = rng.random(views.shape, np.float32)
        made[f"{name}/forward"], made[f"{name}/back"] = A(x), A.T(p)
        fine = pp.covering_grid(views, 40.0, 3.0)
        made[f"{name}/covering"] = np.array([*fine.shape, *fine.spacing, *fine.origin])
    return made


def run(made, key, name, volume=True, **options):
    """The last volume of a reconstruction and the objective of each iterate."""
    steps = list(pp.iterates(scan_of(name), grid(), **{"iterations": 6, "tolerance": 0, "levels": 2, **options}))
    made[f"{key}/objective"] = np.array([step.objective for step in steps])
    if volume:
        made[f"{key}/volume"] = steps[-1].volume.values
    return steps[-1].volume


def methods():
    """Volumes by every method and optimiser on both scans."""
    made = {}
    for name in ("flat", "turned"):
        for way in ("auto", "momentum", "descent", "subsets"):
            for method in ("map", "ml"):
                run(made, f"{name}/{method}/{way}", name, volume=method == "map", method=method, **optimiser(way))
        for method in ("tv", "sirt", "sart", "fbp", "backprojection"):
            run(made, f"{name}/{method}", name, method=method)
        scan = scan_of(name)
        defaults = pp.reconstruct(scan, grid())
        made[f"{name}/defaults"] = defaults.values
        made[f"{name}/stopped"] = pp.reconstruct(scan, grid(), levels=1, tolerance=1e-2).values
        data = pp.Transmission.of(scan)
        A = pp.Projector(scan.views, grid())
        made[f"{name}/backproject"] = pp.backproject(A, data)
        made[f"{name}/fbp, cut"] = pp.fbp(A, data, "shepp-logan", 0.8)
        truth = body().volume(grid()).values
        lump, around = (np.abs(truth - value) < 0.002 for value in (0.05, 0.02))
        measures = pp.nmse(defaults.values, truth), pp.contrast_to_noise(defaults.values, lump, around)
        made[f"{name}/measures"] = np.array(measures)
    return made


def options():
    """Priors, likelihoods and the other choices that a reconstruction has, by their objectives."""
    made = {}
    for potential in ("quadratic", "huber", "lange", "hyperbola", "generalised"):
        run(made, f"prior/{potential}", "flat", prior=prior_of(potential))
    run(made, "prior/given", "turned", prior=pp.Prior("huber", 0.5, 0.004, neighbours=6))
    for likelihood in ("poisson", "gaussian", "least-squares"):
        for name in ("flat", "turned"):
            run(made, f"likelihood/{likelihood}/{name}", name, likelihood=likelihood)
    choices = {
        "curvature": ("optimal", "maximum"),
        "start": ("uniform", pp.Volume(np.full(grid().shape, 0.01), grid())),
        "interpolation": ("nearest", "median"),
        "levels": (1, 3),
        "relaxation": (0.5,),
    }
    for option, values in choices.items():
        for k, value in enumerate(values):
            method = "sart" if option == "relaxation" else "map"
            run(made, f"{option}/{k}", "flat", volume=False, method=method, **{option: value})
    part = pp.region_grid(grid(), (-10, -8, 12), (12, 8, 28))
    local = pp.local_scan(scan_of("flat"), grid(), part, iterations=6)
    made["region/counts"], made["region/incident"] = local.counts, local.incident
    made["region/volume"] = pp.reconstruct(local, part, iterations=6, levels=1).values
    return made


def corrections():
    """Beam hardening by one material and two, and what makes the views agree."""
    scan, made, few = scan_of("flat"), {}, {"iterations": 6, "levels": 1, "tolerance": 0}
    spectrum = pp.Spectrum((3, 5, 2), (1.6, 1.0, 0.8))
    curves = {"polynomial": pp.Polynomial((1.08, -0.011)), "spectrum": spectrum}
    for name, curve in curves.items():
        made[f"precorrected/{name}"] = pp.precorrected(scan, curve).counts

        def hardened(s, curve=curve):
            return pp.Hardened(pp.Transmission.of(s), curve)

        made[f"hardened/{name}"] = pp.reconstruct(scan, grid(), likelihood=hardened, **few).values
    materials = pp.TwoMaterials((3, 5, 2), (1.6, 1.0, 0.8), (2.2, 1.0, 0.5), 0.025, 0.06)
    first = pp.reconstruct(scan, grid(), **few)
    behind = two_materials(likelihood=False)(scan, grid(), materials, rounds=1, **few)
    likelihood = two_materials(likelihood=True)(materials, first)
    made["two materials/volume"] = behind.values
    made["two materials/once"] = pp.reconstruct(scan, grid(), likelihood=likelihood, **few).values
    calibrate, apply = public("calibrate", "refine"), public("apply_calibration", "refined")
    found = calibrate(scan, grid(), rounds=2, iterations=4, fine=2.0)
    made["views/gains"], made["views/shifts"] = found.gains, found.shifts
    again = apply(scan, found)
    made["views/counts"], made["views/origin"] = again.counts, views_arrays(again.views)["origin"]
    region = np.ones((30, 38), bool)
    made["views/gain, shift"] = np.array(
        [
            pp.view_gain(scan.counts[0], scan.counts[1], region),
            *pp.image_shift(scan.counts[0], scan.counts[1], region),
        ]
    )
    made["views/without"] = pp.without_displacement(scan.views, np.arange(12.0).reshape(6, 2), grid())
    return made


@cache
def kidney_labels():
    """The left kidney of the sample CT with a ball as its lump, cut out of the whole."""
    whole = pp.read_labels(next(Path(pp.__file__).parent.rglob("abdomen/labels.nii.gz")))
    inside = np.argwhere(whole.values == whole.value_of("kidney_left"))
    low, high = inside.min(axis=0) - 3, inside.max(axis=0) + 4
    values = whole.values[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
    values = np.where(values == ORGAN, ORGAN, 0)
    cut = pp.Grid(values.shape, whole.grid.spacing, whole.grid.points(low)[0], whole.grid.direction)
    at = np.argwhere(np.ones(values.shape))
    middle = cut.points(inside.mean(axis=0) - low)
    ball = (np.linalg.norm(cut.points(at) - middle, axis=1) < 13).reshape(values.shape)
    return pp.Labels(np.where(ball & (values == ORGAN), LUMP, values), cut, {ORGAN: "kidney", LUMP: "lump"})


@cache
def kidney_mesh():
    return pp.tetrahedralize(kidney_labels(), "kidney", edge=11.0, inclusions=["lump"])


@cache
def kidney():
    """The kidney with its lump, lying on its back, its springs fitted."""
    mesh = kidney_mesh()
    return pp.fit(mesh, {"kidney": 6.0, "lump": 30.0}, 0.45, pp.resting_on(mesh, (0, 1, 0), depth=17.0), element="P1")


def mesh_arrays(mesh):
    return {"nodes": mesh.nodes, "tets": mesh.tets, "region": mesh.region}


def meshes():
    """Meshes of one region and of two, with their figures, and which nodes each support holds."""
    labels = kidney_labels()
    plain = pp.Labels(np.where(labels.values > 0, 1, 0), labels.grid)
    made = {}
    for name, mesh in (("two", kidney_mesh()), ("one", pp.tetrahedralize(plain, 1, edge=14.0))):
        made.update({f"{name}/{key}": values for key, values in mesh_arrays(mesh).items()})
        quality = vars(pp.mesh_quality(mesh, labels if name == "two" else plain))
        numbers = [value for value in quality.values() if isinstance(value, int | float)]
        made.update({f"{name}/quality {k}": value for k, value in enumerate(numbers)})
    mesh = kidney_mesh()
    top, middle = mesh.nodes[mesh.nodes[:, 1].argmin()], mesh.nodes.mean(axis=0)
    made["resting"] = pp.resting_on(mesh, (0, 1, 0))
    made["near"] = public("fixed_near", "held_near")(mesh, top, 25.0)
    made["beyond"] = public("fixed_beyond", "held_beyond")(mesh, middle, (0, 0.2, 1))
    return made


def images():
    """A segmentation and volumes on other grids."""
    volume = pp.reconstruct(scan_of("flat"), grid(), method="sart", iterations=3)
    made = {"organ": pp.segment(volume, keep="largest", fill_holes=True).values}
    onto = pp.segment(volume, 0.012, smooth=1.0, fill_slices=True, opening=1.0)
    made["smoothed"] = onto.values
    made["lump"] = pp.segment(volume, 0.03, name="lump", onto=onto, inside="organ").values
    other = pp.Grid((7, 16, 15), (3, 2, 2.5), (-17, -14, 12))
    for interpolation in ("linear", "nearest", "median"):
        made[f"resample/{interpolation}"] = pp.resample(volume, other, interpolation).values
    return made


def places(tissue):
    """Three points of the surface that lie apart, and inward pushes of them, mm."""
    mesh = tissue.mesh
    skin = mesh.nodes[mesh.surface_nodes]
    front = skin[skin[:, 1] < np.quantile(skin[:, 1], 0.4)]
    points = np.stack([front[(front @ way).argmax()] for way in ((0, -1, 0), (0, -0.5, 1), (0, -0.5, -1))])
    return points, np.array([(0.5, 5.0, 0.0), (0.0, 3.0, -2.0), (1.0, 3.0, 2.0)])


def pushes():
    """What every model and the elements answer to one contact, to three, and with friction."""
    tissue, made = kidney(), {}
    points, ways = places(tissue)
    solvers = {name: pp.model(tissue, name) for name in MODELS}
    solvers.update({f"elements {e}": pp.finite_elements(tissue, e) for e in ("P1", "P2", "mixed")})
    solvers["finite strain"] = pp.finite_strain(tissue)
    for name, solver in solvers.items():
        answers = {"one": solver.push(points[0], ways[0], 15.0), "three": solver.push(points, ways, 15.0)}
        if name in ("compliance", "elements P1"):
            answers["friction"] = solver.push(points, ways, 15.0, friction=0.2)
        for case, answer in answers.items():
            made[f"{name}/{case}/force"] = answer.force
            made[f"{name}/{case}/displacement"] = answer.displacement
            made[f"{name}/{case}/sweeps"] = answer.sweeps
            made[f"{name}/{case}/error"] = answer.error if answer.error > ROUNDING else 0.0
    made["force map"] = pp.force_map(tissue, 4.0, 15.0, points)
    select = public("select_model", "ladder")(
        tissue, within=0.5, force=0.1, contacts=2, element="P1", models=["blocks", "springs"]
    )
    tried = next(v for v in vars(select).values() if isinstance(v, tuple))
    columns = zip(*(dataclasses.astuple(one)[1:5] for one in tried), strict=True)  # enough, sweeps, mm, share of force
    made.update({f"selection/{k}": np.array(column) for k, column in enumerate(columns)})
    return made


def fits():
    """The springs of the kidney and their report, and springs of another law."""
    made = {}
    mesh = kidney_mesh()
    fixed = pp.resting_on(mesh, (0, 1, 0), depth=17.0)
    other = pp.fit(mesh, 5.0, 0.4, fixed, law="linear", rows="rings", element="P1")
    for name, tissue in (("kidney", kidney()), ("linear", other)):
        report, springs = tissue.report, tissue.springs
        made[f"{name}/rsc"], made[f"{name}/scale"] = springs.rsc, springs.scale
        for key in ("young", "poisson", "fixed"):
            made[f"{name}/{key}"] = getattr(tissue, key)
        for key in ("points", "push", "worst", "rms", "truth_force", "spring_force", "error_map", "force_error"):
            made[f"{name}/{key}"] = getattr(report, key)
    return made


def commands(tissue, ticks=600):
    """Of a hand, a needle and a tool in space, tick by tick."""
    points, ways = places(tissue)
    rows = []
    for s in np.arange(ticks) / ticks:
        free = points[1] + (6.0 * s, min(16 * s - 4, 4.0), -5.0 * s)  # touches, presses, slides
        rows.append(
            [
                pp.Command(True, tuple(points[0]), tuple(min(1.0, 2 * s) * ways[0])),
                pp.Command(True, tuple(points[2]), (0.0, 14.0 * s, 4.0 * s), kind="needle"),
                pp.Command(True, tuple(free), kind="free"),
            ]
        )
    return rows


def session_of(tissue, first="blocks"):
    options = {"interval": 0} if first == "neo-hookean" and hasattr(pp._core, "multirate") else {}  # as in version 0.1
    return pp.Session(pp.model(tissue, first, **options), radius=15.0, sweeps=6, friction=0.3)


def recorded(tissue):
    """A session with a change of model and two marks: it, and its forces (ticks, 4, 3) N."""
    session, rows = session_of(tissue), commands(tissue)
    forces = [session.step(rows[:250])]
    session.mark(0, 0)
    session.change(pp.model(tissue, "compliance"), 4)
    forces.append(session.step(rows[250:500]))
    session.mark(1, 1)
    forces.append(session.step(rows[500:]))
    return session, np.concatenate(forces)


def figures(result):
    """Of a score, by name."""
    names = ("max_force", "mean_force", "over_force", "work", "max_strain", "strained")
    return {name: getattr(result, name) for name in names}


def sessions():
    """A session in lockstep, its record, its replay from a file, and its score."""
    tissue, made = kidney(), {}
    session, made["forces"] = recorded(tissue)
    made["displacement"] = session.displacement
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session.h5"
        pp.write_record(path, session.record())
        record = pp.read_record(path)
    for name in ("ticks", "tools", "kinds", "points", "displacements", "digest_ticks", "switches", "lacking", "marks"):
        made[f"record/{name}"] = np.asarray(getattr(record, name))
    made[HASHES + "digests"] = record.digests
    made["instructions"] = np.array(record.instructions)
    again = session_of(tissue)
    assert again.replay(record) is None, "the replay differs from the session"
    made["replayed/displacement"] = again.displacement
    result = pp.score(record, tissue, pp.Task("biopsy", target="lump", strain=0.1, force=0.5))
    made.update({f"score/{name}": value for name, value in figures(result).items()})
    for name in ("path", "time", "force", "strain_time", "strain"):
        made[f"score/{name}"] = np.asarray(getattr(result, name))
    for name in MODELS:
        made[f"forces/{name}"] = session_of(tissue, name).step([row[0] for row in commands(tissue, 120)])
    return made


PARTS = {
    part.__name__: part
    for part in (scans, projectors, methods, options, corrections, meshes, images, fits, pushes, sessions)
}


def everything(only=None):
    """All arrays by name; says on the way how long each part takes."""
    made = {}
    for name, part in PARTS.items():
        if only in (None, name):
            began = time.perf_counter()
            made.update({f"{name}/{key}": np.asarray(values) for key, values in part().items()})
            print(f"{name}: {time.perf_counter() - began:.1f} s", file=sys.stderr)
    return made


def difference(kept, now):
    """Largest difference over the largest value; inf for arrays of other shapes, 0 for the same bits."""
    if kept.dtype == now.dtype and kept.shape == now.shape and kept.tobytes() == now.tobytes():
        return 0.0
    if kept.shape != now.shape or kept.dtype.kind not in "fiub" or now.dtype.kind not in "fiub":
        return np.inf
    if not kept.size:
        return 0.0 if kept.dtype.kind == now.dtype.kind else np.inf
    a, b = kept.astype(np.float64), now.astype(np.float64)
    if (np.isfinite(a) != np.isfinite(b)).any():
        return np.inf
    sound = np.isfinite(a)
    if (a[~sound] != b[~sound])[~np.isnan(a[~sound])].any():
        return np.inf
    most = np.abs(a[sound]).max(initial=0.0)
    off = float(np.abs(a[sound] - b[sound]).max(initial=0.0))
    return off / most if most > 0 else (0.0 if off == 0 else np.inf)


def compared(kept, now, alike):
    """Prints a line for each array; True if all are near enough. alike: whether hashes can be compared, too."""
    bad = 0
    for name in sorted(set(kept) | set(now)):
        if name.endswith("/instructions") or (HASHES in name and not alike):
            print(f"{name}: not compared")
            continue
        if name not in kept or name not in now:
            print(f"{name}: MISSING {'in the file' if name not in kept else 'now'}")
            bad += name in kept
            continue
        off = difference(kept[name], now[name])
        same = kept[name].dtype == now[name].dtype and kept[name].tobytes() == now[name].tobytes()
        wrong = off > LIMIT or (HASHES in name and not same)
        meant = name.startswith(CONTACTS)
        bad += wrong and not meant
        told = "equal to the bit" if same and off == 0 else f"{off:.2g}"
        print(f"{name}: {('CONTACT WEIGHTS: ' if meant else 'WRONG: ') if wrong else ''}{told}")
    print(f"{len(now)} arrays, {bad} missing or wrong")
    return bad == 0


def main():
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    what = words.add_mutually_exclusive_group(required=True)
    what.add_argument("-o", "--output", type=Path, help="file to write (.npz)")
    what.add_argument("--compare", type=Path, metavar="FILE", help="file to compare with (.npz)")
    words.add_argument("--only", choices=PARTS, help="one part alone")
    given = words.parse_args()
    if given.output:
        np.savez_compressed(given.output, **everything(given.only))
        return 0
    with np.load(given.compare) as file:
        kept = {name: file[name] for name in file.files if given.only in (None, name.split("/")[0])}
    now = everything(given.only)
    machine = "sessions/instructions"
    old, new = (str(each.get(machine)) for each in (kept, now))
    alike = new in (old, f"{old}, SkylakeX")  # version 0.1 did not say whose BLAS it had: that of the machine it ran on
    return 0 if compared(kept, now, alike) else 1


if __name__ == "__main__":
    sys.exit(main())
