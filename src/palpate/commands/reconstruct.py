"""`palpate reconstruct`: from a scan to a volume."""

from collections import deque
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import palpate as pp
from palpate.commands.archive_option import archive_option
from palpate.commands.findings import warn
from palpate.commands.progress import progress
from palpate.commands.run_report import report_figures, write_report
from palpate.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from palpate.reconstruction.models.likelihood import Likelihood


Method = StrEnum("Method", "map ml tv sirt sart fbp backprojection")
StartImage = StrEnum("StartImage", "auto backprojection uniform")


class PriorName(StrEnum):
    """Potentials of the prior."""

    lange = "lange"
    huber = "huber"
    quadratic = "quadratic"
    hyperbola = "hyperbola"
    generalized = "generalized"
    generalised = "generalised"  # the spelling of version 0.1


class WindowName(StrEnum):
    """Tapers of the ramp."""

    hann = "hann"
    hamming = "hamming"
    cosine = "cosine"
    shepp_logan = "shepp-logan"
    ram_lak = "ram-lak"


class LikelihoodName(StrEnum):
    """What the values are."""

    poisson = "poisson"
    gaussian = "gaussian"
    least_squares = "least-squares"


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("reconstruct", short_help="Reconstructs a volume from a scan.")(reconstruct_command)


@archive_option((".h5", ".zarr"), ".nii.gz")
def reconstruct_command(
    ctx: typer.Context,
    scan: Annotated[Path, typer.Argument(help="Scan (.h5, .zarr); palpate scan import makes one.", show_default=False)],
    output: Annotated[
        Path,
        typer.Option("-o", "--output", help="Volume: .nii.gz, .nrrd, .mha, .dcm, .zarr, .tif; folder: CT."),
    ],
    thickness: Annotated[float | None, typer.Option(help="Depth of the object from the panel up, mm.")] = None,
    spacing: Annotated[float | None, typer.Option(help="Voxel in the slice, mm. Default: the pixel's shadow.")] = None,
    like: Annotated[Path | None, typer.Option(help="Volume file whose grid is taken instead.")] = None,
    region: Annotated[str | None, typer.Option(help="Only x0,x1,y0,y1,z0,z1 mm; around it is coarse.")] = None,
    halvings: Annotated[int, typer.Option(help="How often what lies around the region is halved in resolution.")] = 1,
    levels: Annotated[
        int | None, typer.Option(help="Resolutions, coarse to fine; 1 is the finest alone. Default: from the grid.")
    ] = None,
    method: Annotated[Method, typer.Option(help="map has a prior, ml none.")] = Method.map,
    likelihood: Annotated[
        LikelihoodName, typer.Option(help="Counts, noisy read-out, intensities.")
    ] = LikelihoodName.poisson,
    gain: Annotated[float, typer.Option(help="What a photon adds to the scan's values.")] = 1.0,
    electronic: Annotated[float, typer.Option(help="Read-out noise, standard deviation in the scan's values.")] = 0.0,
    hardening: Annotated[
        str | None,
        typer.Option(
            help="Beam hardening: l shows as c1 l + c2 l² + ... of c1,c2,..., or a file of weight,ratio lines."
        ),
    ] = None,
    bones: Annotated[
        Path | None, typer.Option(help="A first volume, whose bones harden too: the file's third column.")
    ] = None,
    bone_range: Annotated[
        str, typer.Option(help="Soft tissue up to here, bone from there, 1/mm; a mixture between.")
    ] = "0.03,0.08",
    scatter: Annotated[
        str,
        typer.Option(help="none, estimate (needs --kv), or a file of photons a pixel (.npy); adds to the background."),
    ] = "none",
    kv: Annotated[float | None, typer.Option(help="Tube voltage for --scatter estimate, kV.")] = None,
    beam: Annotated[str, typer.Option(help="Its anode and filter: W/Rh, W/Ag, W/Al, Mo/Mo, Rh/Rh.")] = "W/Rh",
    air_gap: Annotated[float, typer.Option(help="From the object down to the panel, mm.")] = 15.0,
    compressed: Annotated[
        float | None, typer.Option(help="Thickness of the breast, mm, for --scatter estimate.")
    ] = None,
    antiscatter_grid: Annotated[str, typer.Option(help="none, or linear (ratio 5, 31 lines a cm).")] = "none",
    blur: Annotated[
        str,
        typer.Option(
            help="scan (what its file says), none, or widths of panel and focal spot in mm and a height: 0.2,0.3,40."
        ),
    ] = "scan",
    prior: Annotated[
        PriorName | None,
        typer.Option(
            help="How neighbours are held together. Default: lange, for smooth objects; quadratic keeps detail."
        ),
    ] = None,
    resolution: Annotated[
        str | None,
        typer.Option(help="Width that a point shall have in the slice: 0.6mm. Sets the quadratic prior's strength."),
    ] = None,
    smooth: Annotated[
        bool,
        typer.Option("--smooth", help="For an object that is even but for large structures: noise alone makes none."),
    ] = False,
    strength: Annotated[
        float | None, typer.Option(help="Of the prior, 1/mm, or of tv. Default: from the data.")
    ] = None,
    edge: Annotated[float | None, typer.Option(help="Difference that is kept, 1/mm. Default: from the data.")] = None,
    neighbours: Annotated[int, typer.Option(help="6, 18 or 26 voxels around each.")] = 26,
    exponent: Annotated[float, typer.Option(help="Of the generalized prior, 1 to 2: it grows so for jumps.")] = 1.2,
    start: Annotated[
        StartImage, typer.Option(help="Of the coarsest level. auto: uniform within a support.")
    ] = StartImage.auto,
    optimizer: Annotated[
        str, typer.Option(help="Of map and ml: auto, momentum, descent, subsets, or one of your own (--plugin).")
    ] = "auto",
    optimiser: Annotated[str | None, typer.Option(hidden=True)] = None,
    iterations: Annotated[int, typer.Option(help="At most; on coarser levels twice as many a level.")] = 50,
    tolerance: Annotated[float, typer.Option(help="A level ends when an iteration gains less than this share.")] = 1e-3,
    window: Annotated[WindowName, typer.Option(help="Of fbp's ramp.")] = WindowName.hann,
    cutoff: Annotated[float, typer.Option(help="Where fbp's ramp ends, share of the Nyquist frequency.")] = 1.0,
    relaxation: Annotated[float, typer.Option(help="Of sart, between 0 and 2; less for noise.")] = 1.0,
    support: Annotated[
        str,
        typer.Option(help="Where the object may be: none (everywhere), hull (by its shadows), or a file of labels."),
    ] = "none",
    samples: Annotated[
        int,
        typer.Option(
            help="Samples of the posterior, by a quadratic prior; writes their standard deviation to NAME-std."
        ),
    ] = 0,
    seed: Annotated[int, typer.Option(help="Of the samples' noise.")] = 0,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the checkpoint beside the output.")] = False,
    checkpoint_every: Annotated[int, typer.Option(help="Iterations between checkpoints.")] = 5,
    check: Annotated[bool, typer.Option(help="Look for mistakes before and after, and warn.")] = True,
    memory: Annotated[
        str | None, typer.Option(help="What does not fit lies in files: 4GB. The same volume.", show_default=False)
    ] = None,
    scratch: Annotated[
        Path | None,
        typer.Option(help="For --memory: folder of those files. Default: the output's.", show_default=False),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(help="Write geometry, findings, strength, fit as JSON there.", show_default=False)
    ] = None,
) -> None:
    """Example: [bold]palpate reconstruct breast.h5 -o breast.nii.gz --thickness 51.2[/bold]

    Reconstructs a volume from a scan.

    For what is small and faint, with a chosen resolution:
    palpate reconstruct breast.h5 -o breast.nii.gz --thickness 51.2 --resolution 0.6mm

    For a body that is even but for large structures, at a low dose:
    palpate reconstruct slab.h5 -o slab.nii.gz --thickness 48 --smooth

    With --samples 30 breast-std.nii.gz tells how uncertain each voxel is.

    Each scan of a folder, on four workers, with a table of results:
    palpate reconstruct study/ -o volumes --thickness 51.2 --on 4

    More than fits into memory:
    palpate reconstruct large.h5 -o large.zarr --thickness 51.2 --memory 4GB

    Ctrl-C keeps the last iterate in a checkpoint beside the output; the
    same command with --resume goes on from it.
    """
    from palpate.atomic_write import writable
    from palpate.reconstruction.air_level import without_sheet
    from palpate.reconstruction.checkpoint import checkpoint_path, fingerprint, read_checkpoint, with_checkpoints
    from palpate.reconstruction.memory_limit import scratch_bytes
    from palpate.reconstruction.posterior import (
        approximate_posterior,
        check_blur,
        check_sampling,
        mean_and_std,
        quadratic_prior,
        sample_steps,
        std_path,
    )
    from palpate.reconstruction.prior_parameters import explain_prior
    from palpate.reconstruction.reconstruct import OLD_SPELLING, OPTIONS
    from palpate.reconstruction.region_of_interest import crop_to_region, reconstruct_full_field
    from palpate.scans.scatter.scan_scatter import add_scatter
    from palpate.volumes.io import writable_volume

    writable_volume(output)
    if memory is not None:
        ctx.with_resource(pp.memory_limit(memory, output.resolve().parent if scratch is None else scratch))
    elif scratch is not None:
        raise DataError("scratch: it is for --memory; give that too, such as --memory 4GB")
    if report is not None:
        writable(report)
    if samples:
        check_sampling(samples, seed)
        writable_volume(std_path(output))
    if optimiser is not None:
        typer.echo(f"note: --optimiser: write --optimizer; {OLD_SPELLING}", err=True)
        optimizer = optimiser
    beside = checkpoint_path(output)
    measured = pp.read_scan(scan)
    if gain != 1 or electronic != 0:
        m = measured
        measured = pp.integrating_scan(
            m.counts, m.incident, m.views, m.background, m.mask, gain=gain, electronic=electronic
        )
        measured = pp.Scan(
            measured.counts, measured.incident, m.views, measured.background, measured.mask, m.notes, m.blur
        )
    measured = add_scatter(measured, scatter, kv, beam, air_gap, antiscatter_grid, compressed)
    measured = replace(measured, blur=_blur(blur, measured.blur))
    grid = pp.read_volume(like).grid if like else pp.covering_grid(measured.views, thickness, spacing)
    here = ("prior", "resolution", "optimizer", "optimiser", "iterations", "support", "resume")
    options: dict[str, Any] = {name: ctx.params[name] for name in OPTIONS if name in ctx.params and name not in here}
    width = None if resolution is None else _millimetres("--resolution", resolution)
    kind = prior or (PriorName.lange if smooth or (width is None and not samples) else PriorName.quadratic)
    chosen = pp.Prior(kind.value, strength, edge, neighbours, exponent, width, smooth)
    if samples:
        check_blur(measured, likelihood.value if hardening is None else "hardened")
        quadratic_prior(chosen, width, method.value)
    options["prior"], options["optimizer"] = chosen, optimizer
    found = pp.check_scan(measured, grid) if check and not resume else []
    warn(found)
    part = pp.region_grid(grid, *corners(region)) if region else None
    if support not in ("none", "hull") and part is not None:
        raise DataError("support: with --region only none or hull, since a file's mask is on one grid")
    if support != "none":
        measured = without_sheet(measured) if part is not None else measured  # the sheet lies outside the support
        options["support"] = support if support == "hull" else pp.read_labels(support)
    if hardening is None and bones is not None:
        raise DataError("bones: they need --hardening with a file of weight,soft,bone lines")
    first = pp.read_volume(bones) if bones else None
    spectrum = Path(hardening).read_text() if hardening is not None and Path(hardening).is_file() else hardening
    stages = {"region": part, "halvings": halvings, "hardening": spectrum, "bones": first, "bone range": bone_range}
    named = {"start": "backprojection"} if start is StartImage.auto else {}  # as version 0.1 wrote it
    named |= {"seed": str(seed)} if samples else {}
    notes = measured.notes
    run = fingerprint(measured, {"grid": grid, **options, **stages, **named})
    if hardening is not None:
        if part is not None:
            raise DataError(
                "hardening: not together with --region yet; reconstruct the whole, or correct the scan first"
            )
        options["likelihood"] = _hardened(likelihood.value, hardening, first, bone_range)
    last = read_checkpoint(beside, run) if resume else None
    try:
        if part is not None:
            coarse = {**options, "method": "map" if method in ("fbp", "backprojection") else method.value}
            if support == "hull":
                options["support"] = pp.support_hull(measured, part)  # by all of the panel
            pp.iterates(crop_to_region(measured, part), part, **options)  # what cannot be is refused here, before work
            steps = reconstruct_full_field(measured, grid, halvings=halvings, **coarse, iterations=iterations)
            field = deque(_shown(steps, iterations), maxlen=1)[0]  # and no iterate before it
            measured, grid = pp.local_scan(measured, grid, part, field.volume), part
        reached = last if last is None or "mean" not in last.state else replace(last, finished=True)
        steps = pp.iterates(measured, grid, **options, iterations=iterations, resume=reached)
        for step in _shown(with_checkpoints(steps, beside, run, checkpoint_every), iterations):
            last = step
        if samples:
            assert last is not None
            laplace = approximate_posterior(measured, grid, last, options)
            steps = with_checkpoints(sample_steps(laplace, last, samples, seed), beside, run, checkpoint_every)
            for step in _sampled(steps, samples):
                last = step
    except KeyboardInterrupt:
        kept = f"{beside} holds the last iterate: the same command with --resume goes on"
        raise KeyboardInterrupt(kept if beside.exists() else "before the first iterate") from None
    assert last is not None
    pp.write_volume(output, replace(last.volume, notes={**notes, **last.volume.notes}))
    if samples:
        _, std = mean_and_std(last)
        pp.write_volume(std_path(output), replace(std, notes={**notes, **std.notes}))
    beside.unlink(missing_ok=True)
    if "sheet" in last.volume.notes.get("support", ""):
        measured = without_sheet(measured)
    left = pp.residuals(measured, last.volume) if check and hardening is None else None
    if left is not None:
        found = [*found, *(after := pp.check_residuals(left))]
        warn(after)
        if after and part is not None and halvings:
            typer.echo(
                "note: what lies around the region is coarse, which may be the cause; try --halvings 0", err=True
            )
    if report is not None:
        write_report(report, report_figures(measured, last, found, left))
    shape = " x ".join(str(n) for n in grid.shape)
    typer.echo(f"{output}: {shape} voxels (z, y, x), objective {last.objective:.6g}, {last.seconds:.0f} s")
    if last.prior is not None:
        typer.echo(explain_prior(chosen, last.prior))
    if memory is not None:
        in_memory, in_files = scratch_bytes()
        typer.echo(f"large arrays: at most {in_memory / 1e9:.2f} GB in memory, {in_files / 1e9:.2f} GB in files")
    if samples:
        import numpy as np

        inside = std.values[last.volume.values > 0]
        middle = f"median {np.median(inside):.2g} 1/mm where the volume is not 0" if inside.size else "no voxel above 0"
        typer.echo(f"{std_path(output)}: standard deviation of {last.iteration} samples, {middle}")


def corners(words: str) -> tuple[list[float], list[float]]:
    """Lowest and highest (x, y, z) of "x0,x1,y0,y1,z0,z1"."""
    numbers = numbers_in(words)
    if len(numbers) != 6:
        raise DataError(f"region: expected six numbers x0,x1,y0,y1,z0,z1 in mm, got {words!r}")
    return numbers[::2], numbers[1::2]


def _millimetres(option: str, words: str) -> float:
    """Of "0.6mm" or "0.6"."""
    try:
        return float(words.strip().removesuffix("mm"))
    except ValueError:
        raise DataError(f"{option}: {words!r}; give a width in mm, such as 0.6mm") from None


def _blur(words: str, held: "pp.Blur | None") -> "pp.Blur | None":
    """The blur that is meant; held: the scan's own."""
    if words in ("scan", "none"):
        return held if words == "scan" else None
    numbers = numbers_in(words)
    if len(numbers) not in (1, 2, 3):
        raise DataError(
            f"--blur: {words!r}; give scan, none, or PANEL,FOCAL_SPOT[,HEIGHT] in mm, such as 0.2,0.3 or 0.2,0.3,40"
        )
    return pp.Blur(*numbers)


def _hardened(name: str, words: str, first: "pp.Volume | None", between: str) -> "Callable[[pp.Scan], Likelihood]":
    """The named likelihood behind a hardening polynomial or the spectrum in a file; refuses one that cannot be."""
    from palpate.reconstruction.models.beam_hardening import Tabulated
    from palpate.reconstruction.reconstruct import LIKELIHOODS

    curve: pp.Polynomial | pp.Spectrum
    numbers = numbers_in(words)
    if numbers:
        curve = pp.Polynomial(tuple(numbers))
    elif not Path(words).is_file():
        raise DataError(f"hardening: expected numbers c1,c2,... such as 1.08,-0.011, or a file, got {words!r}")
    else:
        columns = pp.read_spectrum(words).T
        if first is not None:
            limits = numbers_in(between)
            if len(columns) != 3 or len(limits) != 2:
                raise DataError(
                    f"bones: expected weight,soft,bone on the lines of {words} and --bone-range with two numbers, got "
                    f"{len(columns)} columns and {between!r}"
                )
            materials = pp.TwoMaterials(*columns, *limits)
            return pp.two_material_beam_hardening_likelihood(materials, first, LIKELIHOODS[name])
        curve = pp.Spectrum(*columns[:2])
    if first is not None:
        raise DataError("bones: they need --hardening with a file of weight,soft,bone lines")
    Tabulated(curve)(0.0)
    return lambda scan: pp.Hardened(LIKELIHOODS[name](scan), curve)


def numbers_in(words: str) -> list[float]:
    """Of "1.08,-0.011"; none if something else is there."""
    try:
        return [float(word) for word in words.split(",")]
    except ValueError:
        return []


def _shown(steps: "Iterator[pp.Step]", iterations: int) -> "Iterator[pp.Step]":
    """The same steps, with progress: level, iteration, objective, and the longest that the rest can take.

    Where volumes lie in files, also the slab of slices that is passed over.
    """
    from palpate.reconstruction.slab_passes import telling_slabs

    words, share = "preparing", 0.0
    with progress() as say, telling_slabs(lambda k, count: say(f"{words}, slab {k} of {count}", share)):
        say(words, share)
        before = 0.0
        for step in steps:
            took, before = step.seconds - before, step.seconds
            # A finer level has four times the voxels and pixels, so each of its iterations takes about four times as long,
            # and at most half as many are made.
            here = iterations * 2**step.level
            rest = took * (here - step.iteration + here * sum(2**k for k in range(1, step.level + 1)))
            words = f"level {step.level}, iteration {step.iteration}, objective {step.objective:.6g}"
            if not step.finished:
                words += f", at most {rest:.0f} s left"
            share = 1.0 if step.finished else min(step.iteration / here, 0.99)
            say(words, share)
            if step.finished:
                words, share = "preparing", 0.0  # the next level
            yield step


def _sampled(steps: "Iterator[pp.Step]", samples: int) -> "Iterator[pp.Step]":
    """The same steps of `sample_steps`, with progress."""
    with progress() as say:
        say("samples of the posterior", 0.0)
        for step in steps:
            say(f"sample {step.iteration} of {samples}", step.iteration / samples)
            yield step
