"""The demo on a real CT: labels to a kidney that can be touched."""

from collections.abc import Mapping

from palpate.demos.organ_pipeline import files_section, fit_stage, mesh_section, mesh_stage, tissue_section
from palpate.report.html_report import Section, write_report
from palpate.report.stages import Stages
from palpate.samples import KIDNEY_BED, KIDNEY_LABEL, KIDNEY_POISSON, sample
from palpate.tissue.boundary_conditions import resting_on
from palpate.tissue.named_tissues import tissue_properties
from palpate.tissue.tissue import Tissue
from palpate.volumes.io import read_labels, read_volume, write_labels, write_volume
from palpate.volumes.volume import Labels
from palpate.volumes.volume_plots import plot_volume

EDGE = 4.0  # mm


def kidney(stages: Stages) -> Mapping[str, Tissue]:
    """CT and labels to mesh, tissue and report.html in the folder of `stages`. Raises `FileError`."""
    folder = sample("abdomen")
    ct = stages("ct.nii.gz", lambda: read_volume(folder / "ct.nii.gz"), write_volume, read_volume)
    labels = stages("labels.nii.gz", lambda: read_labels(folder / "labels.nii.gz"), write_labels, read_labels)
    mesh = mesh_stage(stages, labels, "kidney.vtu", label=KIDNEY_LABEL, edge=EDGE)
    back = (0.0, 1.0, 0.0)  # LPS: y grows towards the back
    extent = float(mesh.nodes[:, 1].max() - mesh.nodes[:, 1].min())
    known = tissue_properties("kidney")
    fixed = resting_on(mesh, back, depth=KIDNEY_BED * extent)
    tissue = fit_stage(stages, mesh, "tissue.vtu", "kidney", KIDNEY_POISSON, fixed)
    organ = labels.values == labels.value_of(KIDNEY_LABEL)
    middle = [int(i.mean()) for i in organ.nonzero()]
    outline = Labels(organ.astype(int), labels.grid)
    sections = [
        Section(
            "CT and labels",
            [
                f"The organ is label {KIDNEY_LABEL!r} of a real CT at {ct.grid.spacing[0]:g} mm, drawn by a network, "
                "not by hand."
            ],
            pictures=[
                (
                    plot_volume(ct, at=ct.grid.points(middle)[0], window=(-160, 240), labels=outline),
                    "HU from -160 to 240, the organ outlined.",
                )
            ],
        ),
        mesh_section(mesh, labels, [f"Edge length asked for: {EDGE:g} mm."]),
        tissue_section(
            tissue,
            [
                f"Young's modulus {known.described('young')}, Poisson's ratio {KIDNEY_POISSON:g}.",
                f"Assumed: the rear {KIDNEY_BED:.0%} of the kidney is bedded in fat and muscle, and its {len(fixed)} nodes "
                "are held still.",
            ],
        ),
        files_section(stages),
    ]
    write_report(
        stages.folder / "report.html", "A kidney under the pointer", "palpate demo kidney --no-browser", sections
    )
    return {"kidney": tissue}
