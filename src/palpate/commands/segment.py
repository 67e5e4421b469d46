"""`palpate segment`."""

from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.archive_option import archive_option
from palpate.commands.progress import doing


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("segment", short_help="Labels a part of a volume.")(segment_command)


@archive_option((".nii.gz", ".nii", ".nrrd", ".mha", ".mhd"), ".nii.gz")
def segment_command(
    volume: Annotated[
        Path,
        typer.Argument(help="Volume file, or the folder of a CT series.", show_default=False),
    ],
    output: Annotated[
        Path,
        typer.Option("-o", "--output", help="Labels: .nii.gz, .nrrd, .mha; .dcm beside DICOM.", show_default=False),
    ],
    lower: Annotated[float | None, typer.Option(help="Lowest value, in the volume's unit. Default: Otsu's.")] = None,
    upper: Annotated[float | None, typer.Option(help="Highest value.")] = None,
    largest: Annotated[bool, typer.Option("--largest", help="Keep the largest connected part only.")] = False,
    seed: Annotated[list[str] | None, typer.Option(help="x,y,z in mm (patient space): keep the part there.")] = None,
    least_volume: Annotated[float, typer.Option(help="Drop parts below this volume, mm³.")] = 0.0,
    fill_holes: Annotated[bool, typer.Option("--fill-holes", help="Fill closed voids.")] = False,
    fill_slices: Annotated[bool, typer.Option("--fill-slices", help="Fill voids closed within a z slice.")] = False,
    smooth: Annotated[float, typer.Option(help="Smooth the volume first, mm.")] = 0.0,
    opening: Annotated[float, typer.Option(help="Remove bridges thinner than a ball of this radius, mm.")] = 0.0,
    name: Annotated[str, typer.Option(help="Name of the new label.")] = "organ",
    onto: Annotated[Path | None, typer.Option(help="Labels to which the new one is added.")] = None,
    inside: Annotated[str | None, typer.Option(help="Only within this label of --onto.")] = None,
    like: Annotated[
        Path | None,
        typer.Option(help="For -o NAME.dcm: DICOM images to refer to (folder or file). Default: VOLUME."),
    ] = None,
    method: Annotated[str, typer.Option(help="threshold, or a segmenter of your own (--plugin).")] = "threshold",
) -> None:
    """Example: [bold]palpate segment ct.nii.gz -o labels.nii.gz --lower 150 --largest[/bold]

    Labels a part of a volume by thresholds, connected parts and seeds.

    A lump inside an organ:
    palpate segment breast.nii.gz -o both.nii.gz --onto labels.nii.gz
    --inside organ --lower 0.06 --largest --name lump

    A DICOM segmentation of a CT series:
    palpate segment ct/ -o seg.dcm --lower 150 --largest --name bone
    """
    from palpate.volumes.io import DICOM, writable_labels
    from palpate.volumes.segmentation import label_volumes

    if like is None and output.suffix.lower() in DICOM:
        like = volume
    writable_labels(output, like)
    with doing(f"segmenting {volume.name}"):
        labels = pp.segment(
            pp.read_volume(volume),
            lower,
            upper,
            keep="largest" if largest else "all",
            seed=[_point(text) for text in seed] if seed else None,
            least_volume=least_volume,
            fill_holes=fill_holes,
            fill_slices=fill_slices,
            smooth=smooth,
            opening=opening,
            name=name,
            onto=None if onto is None else pp.read_labels(onto),
            inside=inside,
            method=method,
        )
    pp.write_labels(output, labels, like)
    for value, volume_ml in label_volumes(labels).items():
        typer.echo(f"{value} ({labels.names.get(value, value)}): {volume_ml:.2f} ml")
    typer.echo(f"wrote {output}")


def _point(text: str) -> list[float]:
    from palpate.errors import DataError

    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise DataError(f"--seed {text!r}: expected x,y,z in mm, such as --seed 12,-40,105.5") from None
    return [x, y, z]
