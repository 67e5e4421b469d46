"""The demo on a real CT: labels to a kidney that can be touched."""

from collections.abc import Mapping

from palpate.samples import sample
from palpate.studies.organ import files_section, fitted, mesh_section, meshed, tissue_section
from palpate.studies.pictures import three_planes
from palpate.studies.report import Section, write_report
from palpate.studies.stages import Stages
from palpate.tissue.materials import MATERIALS
from palpate.tissue.supports import resting_on
from palpate.tissue.tissue import Tissue
from palpate.volumes.files import read_labels, read_volume, write_labels, write_volume
from palpate.volumes.volume import Labels

ORGAN, EDGE, POISSON = "kidney_left", 4.0, 0.45
BED = 0.25  # share of the kidney's depth, from the back, that lies in fat and muscle and is held still


def kidney(stages: Stages) -> Mapping[str, Tissue]:
    """CT and labels to mesh, tissue and report.html in the folder of `stages`. Raises `FileError`."""
    folder = sample("abdomen")
    ct = stages("ct.nii.gz", lambda: read_volume(folder / "ct.nii.gz"), write_volume, read_volume)
    labels = stages("labels.nii.gz", lambda: read_labels(folder / "labels.nii.gz"), write_labels, read_labels)
    mesh = meshed(stages, labels, "kidney.vtu", label=ORGAN, edge=EDGE)
    back = (0.0, 1.0, 0.0)  # LPS: y grows towards the back
    extent = float(mesh.nodes[:, 1].max() - mesh.nodes[:, 1].min())
    material = MATERIALS["kidney"]
    fixed = resting_on(mesh, back, depth=BED * extent)
    tissue = fitted(stages, mesh, "tissue.vtu", material.young, POISSON, fixed)
    organ = labels.values == labels.value_of(ORGAN)
    middle = [int(i.mean()) for i in organ.nonzero()]
    outline = Labels(organ.astype(int), labels.grid)
    sections = [
        Section(
            "CT and labels",
            [
                f"The organ is label {ORGAN!r} of a real CT at {ct.grid.spacing[0]:g} mm, drawn by a network, not by hand."
            ],
            pictures=[
                (three_planes(ct, middle, outline, window=(-160, 240)), "HU from -160 to 240, the organ outlined.")
            ],
        ),
        mesh_section(mesh, labels, [f"Edge length asked for: {EDGE:g} mm."]),
        tissue_section(
            tissue,
            [
                f"Young's modulus {material.young:g} kPa ({material.source}), Poisson's ratio {POISSON:g}.",
                f"Assumed: the rear {BED:.0%} of the kidney is bedded in fat and muscle, and its {len(fixed)} nodes are "
                f"held still.",
            ],
        ),
        files_section(stages),
    ]
    write_report(
        stages.folder / "report.html", "A kidney under the pointer", "palpate demo kidney --no-browser", sections
    )
    return {"kidney": tissue}
