"""The main demo: photon counts of seven views to a breast you can touch, and what a hand would feel of its lesion."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from scipy import ndimage

from palpate.arrays import Float64, Int32
from palpate.demos.checkpointed_reconstruction import reconstruct_stage
from palpate.demos.organ_pipeline import (
    files_section,
    fit_stage,
    lump_section,
    mesh_section,
    mesh_stage,
    tissue_section,
)
from palpate.meshes.tet_mesh import TetMesh
from palpate.reconstruction.default_grid import covering_grid
from palpate.reconstruction.iterate import Step
from palpate.reconstruction.posterior import posterior
from palpate.reconstruction.region_of_interest import local_scan
from palpate.report.figures import curves, projections
from palpate.report.html_report import Section, write_report
from palpate.report.lump_uncertainty_plot import plot_lump_uncertainty
from palpate.report.stages import Stages
from palpate.scans.importers import import_scan
from palpate.scans.io import read_scan, write_scan
from palpate.scans.scan import Scan
from palpate.tissue.boundary_conditions import resting_on
from palpate.tissue.force_error_map import spread_places
from palpate.tissue.lump_detectability import without_region
from palpate.tissue.lump_outline import ball_rule
from palpate.tissue.lump_sampling import lump_uncertainty
from palpate.tissue.lump_uncertainty import LumpUncertainty
from palpate.tissue.named_tissues import tissue_properties
from palpate.tissue.tissue import Tissue
from palpate.volumes.grid import Grid
from palpate.volumes.io import read_labels, write_labels
from palpate.volumes.lesion_detection import Inclusion, ball, find_inclusion
from palpate.volumes.resample import resample
from palpate.volumes.segmentation import segment
from palpate.volumes.volume import Labels, Volume
from palpate.volumes.volume_plots import plot_volume

BREAST, LESION = 1, 2
SLICES, DEPTH = 64, 0.8  # mm; the compressed thickness in the author's slices (samples/breast/geometry.json)
EDGE = 7.0  # mm, of the mesh away from the lesion
PUSH = 5.0  # mm
ASIDE = 20.0  # mm to either side of the lesion: the box whose samples are drawn; the rest stays as reconstructed
VOXEL = 0.8  # mm, of the samples
SAMPLES, ITERATIONS, PLACES = 20, 4, 40
POISSON = 0.45  # nearly incompressible, as far as P1 elements go without locking
TRAINING_RADIUS, TRAINING_DEPTH = 8.0, 12.0  # mm; a lump made up for practice, its centre below the skin


def breast(stages: Stages) -> Mapping[str, Tissue]:
    """Counts to volume, labels, meshes, tissues ("breast", "training") and report.html. Raises `FileError`."""
    scan = stages("scan.h5", lambda: import_scan("breast"), write_scan, read_scan)
    volume, steps = reconstruct_stage(stages, scan, field(scan))
    labels, lesion = found_labels(stages, volume)
    tissue = _tissue(stages, labels, "mesh.vtu", "tissue.vtu", lesion.radius)
    added, at = training_labels(labels)
    training = _tissue(stages, added, "training-mesh.vtu", "training.vtu", TRAINING_RADIUS)
    radius = 8.0  # mm of a fingertip
    made_up = (
        f"added by us at {np.round(at, 1).tolist()} mm, {TRAINING_RADIUS:g} mm in radius, its centre "
        f"{TRAINING_DEPTH:g} mm below the skin; not in the data"
    )
    sections = [
        _scan_section(scan, lesion),
        _volume_section(volume, labels, lesion, steps),
        mesh_section(tissue.mesh, labels, [f"Edge {EDGE:g} mm, finer towards the lesion."]),
        tissue_section(tissue, _assumptions(tissue)),
        lump_section("What a hand would feel of the lesion", tissue, "lesion", PUSH, radius, stages),
        _doubt_section(lesion_doubt(stages, scan, volume, labels, lesion, tissue, radius)),
        lump_section(f"The training lump: {made_up}", training, "lesion", PUSH, radius, stages),
        files_section(stages),
    ]
    write_report(
        stages.folder / "report.html",
        "A breast you can touch, from seven X-ray views",
        "palpate demo --no-browser",
        sections,
    )
    return {"breast": tissue, "training": training}


def field(scan: Scan) -> Grid:
    """The box that the views share, from the panel up to the compression plate."""
    wide = covering_grid(scan.views, thickness=SLICES * DEPTH, spacing=0.4)
    origin = (wide.origin[0], wide.origin[1], wide.bounds[0][2] + DEPTH / 2)
    return Grid((SLICES, *wide.shape[1:]), (DEPTH, *wide.spacing[1:]), origin)


def found_labels(stages: Stages, volume: Volume) -> tuple[Labels, Inclusion]:
    """The breast by Otsu's threshold, and the most conspicuous bright ball in it: nothing is told where to look."""
    organ = segment(volume, keep="largest", fill_holes=True, fill_slices=True, smooth=1.5, name="breast")
    lesion = find_inclusion(volume, organ.values == BREAST)

    def drawn() -> Labels:
        values = organ.values.copy()
        values[ball(volume.grid, lesion.centre, lesion.radius) & (values == BREAST)] = LESION
        return Labels(values, volume.grid, {BREAST: "breast", LESION: "lesion"})

    return stages("labels.nii.gz", drawn, write_labels, read_labels), lesion


def lesion_doubt(
    stages: Stages, scan: Scan, volume: Volume, labels: Labels, lesion: Inclusion, tissue: Tissue, radius: float
) -> tuple[LumpUncertainty, float]:
    """What samples of the posterior about the lesion say of it, and its contrast's standard deviation to first order."""
    low, high = volume.grid.bounds
    middle = np.array(lesion.centre)
    low, high = np.maximum(low, middle - [ASIDE, ASIDE, np.inf]), np.minimum(high, middle + [ASIDE, ASIDE, np.inf])
    region = Grid(np.floor((high - low) / VOXEL)[::-1], (VOXEL,) * 3, low + VOXEL / 2)
    stages.progress("samples of the posterior about the lesion", 0.0)
    part = local_scan(scan, volume.grid, region, outside=volume)
    found = posterior(part, region, samples=SAMPLES, sample_iterations=ITERATIONS)
    inside = resample(Volume((labels.values > 0).astype(np.float32), volume.grid), region, "nearest").values > 0
    rule = ball_rule(found.map, lesion.centre, inside, (lesion.radius / 2, 2 * lesion.radius))
    stiff, soft = (tissue_properties(name).young for name in ("breast-carcinoma", "gland"))
    assert stiff is not None
    doubt = lump_uncertainty(
        found,
        without_region(tissue, "lesion"),
        lump=stiff,
        body=soft,
        rule=rule,
        push=PUSH,
        radius=radius,
        places=spread_places(tissue, radius)[:PLACES],
        progress=lambda share: stages.progress("what a hand would feel, for each sample", share),
    )
    return doubt, found.linear_std(doubt.weights)


def training_labels(labels: Labels) -> tuple[Labels, Float64]:
    """The breast with a made-up lump below the middle of its upper face instead of the lesion, and where it is, mm."""
    organ = labels.values > 0
    columns = organ.any(axis=0)
    # The spot farthest from the outline seen from above, so that the lump has tissue all around.
    depth = ndimage.distance_transform_edt(np.pad(columns, 1), sampling=labels.grid.spacing[1:])[1:-1, 1:-1]
    y, x = np.unravel_index(int(np.argmax(depth)), depth.shape)
    top = int(np.flatnonzero(organ[:, y, x]).max())
    at = labels.grid.points(np.array([[top - TRAINING_DEPTH / labels.grid.spacing[0], y, x]]))[0]
    values = np.where(organ, BREAST, 0)
    values[ball(labels.grid, (at[0], at[1], at[2]), TRAINING_RADIUS) & organ] = LESION
    return Labels(values, labels.grid, {BREAST: "breast", LESION: "lesion"}), at


def fixed_nodes(mesh: TetMesh) -> Int32:
    """What does not move: where the breast rests on the panel, and where it goes on into the chest wall."""
    panel = resting_on(mesh, (0, 0, -1), depth=1.0)
    wall = resting_on(mesh, (0, -1, 0), depth=1.0)
    return np.union1d(panel, wall).astype(np.int32)


def _tissue(stages: Stages, labels: Labels, mesh_name: str, name: str, radius: float) -> Tissue:
    fine = {"lesion": radius / 2}
    options = {"label": "breast", "edge": EDGE, "inclusions": ["lesion"], "closed_at_border": True, "fine": fine}
    mesh = mesh_stage(stages, labels, mesh_name, **options)
    return fit_stage(stages, mesh, name, {"breast": "gland", "lesion": "breast-carcinoma"}, POISSON, fixed_nodes(mesh))


def _scan_section(scan: Scan, lesion: Inclusion) -> Section:
    line_integrals = -np.log(np.maximum(scan.counts, 1) / scan.incident)
    marks = scan.views.project(lesion.centre)[:, 0]
    angles = np.degrees(np.arctan2(scan.views.source[:, 0], scan.views.source[:, 2]))
    return Section(
        "Projections",
        [
            "Seven views of a numerical breast by the US FDA: counts with Poisson noise, "
            f"{float(scan.incident.max()):.0f} photons a pixel with nothing in the beam.",
            "The ring on each view is where the lesion found in the volume re-projects.",
        ],
        pictures=[
            (projections(line_integrals, [f"source at {a:+.0f}°" for a in angles], marks), "-log(counts / incident).")
        ],
    )


def _volume_section(volume: Volume, labels: Labels, lesion: Inclusion, steps: list[Step]) -> Section:
    pictures: list[tuple[Figure, str]] = [
        (
            plot_volume(volume, lesion.centre, labels=labels),
            "Attenuation through the lesion, with the outlines of breast and lesion. The views span 30°, so depth is "
            "smeared: what is sharp in the first plane is drawn out along z in the others.",
        ),
        (plot_volume(volume, lesion.centre, labels=labels, reach=18), "The same, 18 mm about the lesion."),
    ]
    if steps:
        levels = sorted({s.level for s in steps}, reverse=True)
        lines = {f"level {k}": np.array([s.objective for s in steps if s.level == k]) for k in levels}
        longest = max(len(y) for y in lines.values())
        pictures.append(
            (
                curves(np.arange(1, longest + 1), lines, "iteration", "negative log-posterior", log=True),
                "The objective on each level, coarsest first; it compares only within a level.",
            )
        )
    x, y, z = lesion.centre
    return Section(
        "Volume and lesion",
        [
            f"M-MAP-3 on {' x '.join(map(str, volume.grid.shape))} voxels (z, y, x).",
            f"The lesion is the most conspicuous bright ball in the breast: centre ({x:.1f}, {y:.1f}, {z:.1f}) mm, radius "
            f"{lesion.radius:.1f} mm, {lesion.contrast:.4f} 1/mm above its surroundings, {lesion.prominence:.1f} times as "
            f"prominent as the next best place.",
            "Assumed: the lesion is as deep as it is wide, and the breast fills the box between panel and compression "
            "plate where it is bright there, since seven views over 30° do not show depth well.",
        ],
        pictures=pictures,
    )


def _doubt_section(found: tuple[LumpUncertainty, float]) -> Section:
    doubt, first_order = found
    return Section(
        "How sure that is",
        [
            *doubt.text().splitlines(),
            f"The contrast's standard deviation is {doubt.contrast.std(ddof=1):.2g} 1/mm by the samples, and "
            f"{first_order:.2g} 1/mm to first order.",
            f"The samples are drawn within {ASIDE:g} mm of the lesion, in voxels of {VOXEL:g} mm; the rest of the breast, "
            "its outline and its texture do not vary, nor whether this is a lesion at all. `palpate study doubt` tells how "
            "often such intervals hold the truth.",
        ],
        pictures=[
            (
                plot_lump_uncertainty(doubt),
                "What the lesion adds to the force at each place, and the band of it over the samples.",
            )
        ],
    )


def _assumptions(tissue: Tissue) -> list[str]:
    plain, stiff = (tissue_properties(name).described("young") for name in ("gland", "breast-carcinoma"))
    return [
        f"Young's modulus of the breast {plain}, and of the lesion {stiff}.",
        f"Poisson's ratio {POISSON:g}. The numerical breast has no stiffness: a carcinoma is assumed.",
        f"Assumed: the breast rests on the panel and goes on into the chest wall; the {len(tissue.fixed)} nodes there are "
        f"held still.",
    ]
