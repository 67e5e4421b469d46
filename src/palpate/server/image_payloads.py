"""Volumes and scans as `palpate view` sends them to its page."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import AnyArray, Float32
from palpate.reconstruction.models.likelihood import Transmission
from palpate.scans.scan import Scan
from palpate.scans.views import beam_in_words
from palpate.server.json_messages import Image, Stack, Window
from palpate.volumes.display_window import window_presets
from palpate.volumes.patient_axes import has_patient_axes, reorient_to_patient
from palpate.volumes.volume import Volume

MAX_VOXELS = 64_000_000  # 256 MB: the most that a page can hold


@dataclass(frozen=True, eq=False)
class ImagePayload:
    """The description of an image, and the values of each of its stacks."""

    image: Image
    values: list[AnyArray]


def volume_payload(volume: Volume, title: str, water: float | None = None, most: int = MAX_VOXELS) -> ImagePayload:
    """A volume with axes along the patient's, with at most `most` voxels. water: attenuation of water, 1/mm, if known."""
    whole, grid = reorient_to_patient(volume)
    values, factors = block_means(whole, grid.spacing, most)
    values = np.ascontiguousarray(values)
    spacing = np.array(grid.spacing) * factors
    first = (np.minimum(factors, grid.shape) - 1) / 2
    start = volume.grid.indices(grid.points(first))[0]
    steps = volume.grid.indices(grid.points(first + np.diag(factors))) - start
    image = Image(
        title=title,
        scan=False,
        shape=list(values.shape),
        spacing=spacing.tolist(),
        origin=grid.points(first)[0].tolist(),
        direction=grid.direction.ravel().tolist(),
        patient=has_patient_axes(volume),
        file=np.column_stack([steps.T, start]).ravel().tolist(),
        water=water or 0.0,
        note=_note(factors, grid.shape, spacing.tolist(), "voxels"),
        captions=[],
        stacks=[_stack("values", volume.unit, values, water)],
    )
    return ImagePayload(image, [_compact(values)])


def scan_payload(scan: Scan, title: str, most: int = MAX_VOXELS) -> ImagePayload:
    """A scan as line integrals log(b / (y - r)) and as counts; NaN: not measured."""
    lines = np.where(scan.mask, Transmission.of(scan).line_integrals, np.float32(np.nan))
    counts = np.where(scan.mask, scan.counts, np.float32(np.nan))
    pitch = scan.views.panels[0].pitch
    spacing = (np.inf, *pitch)  # views are never averaged
    (lines, factors), (counts, _) = (block_means(values, spacing, most) for values in (lines, counts))
    image = Image(
        title=title,
        scan=True,
        shape=list(counts.shape),
        spacing=[1.0, *(np.array(pitch) * factors[1:]).tolist()],
        origin=[*((np.array(pitch) * (np.array(factors[1:]) - 1) / 2)[::-1]).tolist(), 0.0],
        direction=np.eye(3).ravel().tolist(),
        patient=False,
        file=np.column_stack([np.diag(factors), (np.array(factors) - 1) / 2]).ravel().tolist(),
        water=0.0,
        note=_note(factors, scan.shape, [pitch[0] * factors[1], pitch[1] * factors[2]], "pixels"),
        captions=[beam_in_words(scan.views, k) for k in range(len(scan.views))],
        stacks=[_stack("line integrals", "", lines), _stack("counts", "photons", counts)],
    )
    return ImagePayload(image, [_compact(lines), _compact(counts)])


def block_means(values: Float32, spacing: tuple[float, ...], most: int) -> tuple[Float32, list[int]]:
    """Means over the smallest blocks that leave at most `most` values, and the size of the blocks, (z, y, x)."""
    factors = [1, 1, 1]
    while np.prod([-(-n // f) for n, f in zip(values.shape, factors, strict=True)]) > most:
        lengths = [d * f if f < n else np.inf for d, f, n in zip(spacing, factors, values.shape, strict=True)]
        factors[int(np.argmin(lengths))] += 1
    if factors == [1, 1, 1]:
        return values, factors
    starts = [np.arange(0, n, f) for n, f in zip(values.shape, factors, strict=True)]
    sizes = [np.diff(np.append(s, n)) for s, n in zip(starts, values.shape, strict=True)]
    out = np.empty([len(s) for s in starts], dtype=np.float32)
    for k, z in enumerate(starts[0]):  # slab by slab: the whole volume may fill most of the memory
        slab = values[z : z + factors[0]].mean(axis=0)
        rows = np.add.reduceat(slab, starts[1], axis=0) / sizes[1][:, None]
        out[k] = np.add.reduceat(rows, starts[2], axis=1) / sizes[2]
    return out, factors


def _note(factors: list[int], shape: tuple[int, ...], spacing: list[float], what: str) -> str:
    if factors == [1, 1, 1]:
        return ""
    block = " × ".join(str(f) for f in factors)
    size = " × ".join(f"{d:.3g}" for d in spacing)
    return f"Shown at {size} mm as means of {block} {what}, since {np.prod(shape):,} {what} are too many for a page."


def _stack(name: str, unit: str, values: AnyArray, water: float | None = None) -> Stack:
    presets = [Window(n, low, high, hint) for n, (low, high, hint) in window_presets(values, unit, water).items()]
    return Stack(name, unit, str(_kind(values)), presets)


def _kind(values: AnyArray) -> np.dtype[np.generic]:
    """The smallest of int16, uint16 and float32 that holds the values exactly."""
    probe = values.reshape(-1)[: 1 << 16]
    if not (probe == np.rint(probe)).all() or not (values == np.rint(values)).all():
        return np.dtype(np.float32)
    low, high = values.min(), values.max()
    for kind in (np.int16, np.uint16):
        if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max:
            return np.dtype(kind)
    return np.dtype(np.float32)


def _compact(values: AnyArray) -> AnyArray:
    kind = _kind(values).newbyteorder("<")
    return np.ascontiguousarray(values, dtype=kind)
