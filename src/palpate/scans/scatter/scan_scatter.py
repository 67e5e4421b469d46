"""A scan with its scatter in the background: estimated, or read from a file."""

from pathlib import Path

import numpy as np

from palpate.bounded_read import existing_file
from palpate.errors import DataError, FileError
from palpate.scans.scan import Scan
from palpate.scans.scatter.estimate import estimate_scatter
from palpate.scans.scatter.kernels import scatter_kernels


def add_scatter(
    scan: Scan, scatter: str, kv: float | None, beam: str, gap: float, grid: str, thickness: float | None = None
) -> Scan:
    """The scan with scatter "none", "estimate" (for a beam) or that of a .npy file; its notes say what was assumed.

    Raises `DataError`, `FileError`.
    """
    if scatter == "none":
        return scan
    if "scatter" in scan.notes:
        raise DataError(
            f"scatter: the scan has some in its background already ({scan.notes['scatter']}); leave scatter out, or import "
            f"the scan without it"
        )
    if scatter == "estimate":
        if kv is None:
            raise DataError("scatter: estimate needs the tube voltage (--kv, or kv under beam in the geometry file)")
        kernels = scatter_kernels(kv, beam, grid)
        background = estimate_scatter(scan, kernels, gap, thickness)
        told = "from the counts" if thickness is None else f"{thickness:g} mm"
        notes = {"scatter": "estimate", **kernels.assumed, "air gap": f"{gap:g} mm", "thickness": told}
    else:
        background = scan.background + _read(Path(scatter), scan.shape)
        notes = {"scatter": f"file {Path(scatter).name}"}
    return Scan(scan.counts, scan.incident, scan.views, background, scan.mask, {**scan.notes, **notes}, scan.blur)


def _read(path: Path, shape: tuple[int, int, int]) -> np.ndarray:
    if path.suffix != ".npy":
        raise FileError(f"{path}: scatter is none, estimate, or a file of NumPy (.npy) with photons a pixel")
    try:
        values = np.load(existing_file(path), mmap_mode="r", allow_pickle=False)
    except FileError:
        raise
    except Exception as problem:  # what stands in the header is evaluated
        raise FileError(f"{path}: not a whole NumPy file ({problem}); copy or save it again") from None
    if values.shape != shape or values.dtype.kind not in "fiu" or not np.isfinite(values).all() or (values < 0).any():
        raise DataError(f"{path}: expected scatter of shape {shape}, 0 or more, got {values.dtype} {values.shape}")
    return np.asarray(values, np.float32)
