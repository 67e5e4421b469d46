"""SART of another code, the Reconstruction Toolkit (itk-rtk), where it is installed: a reference from outside."""

from collections.abc import Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt

from palpate.arrays import AnyArray, Float32
from palpate.scans.intensity_correction import line_integrals
from palpate.scans.scan import Scan
from palpate.volumes.grid import Grid
from palpate.volumes.resample import resample
from palpate.volumes.volume import Volume

COARSE_PASSES = 20
PASSES = (2, 4, 6, 8, 12, 16, 24, 32, 48, 64)  # of the candidates


def installed() -> bool:
    """Whether itk-rtk is there; palpate does not require it."""
    try:
        return bool(version("itk-rtk"))
    except PackageNotFoundError:
        return False


def rtk_sart(
    scan: Scan, grid: Grid, passes: int, values: Float32, relaxation: float = 1.0, matched: bool = False
) -> Float32:
    """SART by RTK with its own Joseph projectors, from `values` on, (z, y, x) 1/mm.

    matched: whether it projects back by the transpose, as RTK does not unless told to.
    It knows no mask: unmeasured pixels take the value of the nearest measured one.
    """
    import itk
    from itk import RTK

    image = itk.Image[itk.F, 3]
    solver = RTK.SARTConeBeamReconstructionFilter[image, image].New()
    start = itk.image_from_array(values)
    start.SetSpacing(grid.spacing[::-1])
    start.SetOrigin(np.asarray(grid.origin).tolist())
    shadow = itk.image_from_array(_filled(scan))
    pitch = scan.views.panels[0].pitch
    shadow.SetSpacing((pitch[1], pitch[0], 1.0))
    shadow.SetOrigin((0.0, 0.0, 0.0))
    solver.SetInput(0, start)
    solver.SetInput(1, shadow)
    solver.SetGeometry(_geometry(itk, RTK, scan))
    solver.SetNumberOfIterations(passes)
    solver.SetLambda(relaxation)
    if matched:
        solver.SetBackProjectionFilter(solver.BackProjectionType_BP_JOSEPH)
    solver.SetEnforcePositivity(True)
    solver.SetDisableDisplacedDetectorFilter(True)
    solver.Update()
    return np.array(itk.array_view_from_image(solver.GetOutput()), np.float32)


def rtk_estimates(levels: Sequence[tuple[Scan, Grid]]) -> Iterator[Iterator[tuple[str, Float32]]]:
    """RTK's SART, started from its like on the coarse grid, after so many passes: one path."""
    yield _candidates(levels)


def _candidates(levels: Sequence[tuple[Scan, Grid]]) -> Iterator[tuple[str, Float32]]:
    below, grid, done = levels[-1][1], levels[0][1], 0
    coarse = rtk_sart(*levels[-1], COARSE_PASSES, np.zeros(below.shape, np.float32))
    values = resample(Volume(coarse, below), grid, "linear").values
    for passes in PASSES:
        values = rtk_sart(*levels[0], passes - done, values)
        done = passes
        yield f"{passes} passes", values


def _geometry(itk: Any, rtk: Any, scan: Scan) -> Any:
    geometry = rtk.ThreeDCircularProjectionGeometry.New()
    point, vector = itk.Point[itk.D, 3], itk.Vector[itk.D, 3]
    for source, panel, parallel in zip(scan.views.source, scan.views.panels, scan.views.parallel, strict=True):
        if parallel:  # RTK's own parallel geometry turns about y; a distance of 0 to the panel says so
            if abs(panel.row_axis[1] - 1) > 1e-6:
                raise ValueError("RTK's parallel beams turn about y, with the panel's rows along y")
            turn = float(np.degrees(np.arctan2(source[0], source[2])))
            geometry.AddProjection(
                1000.0, 0.0, turn, float(panel.origin @ panel.column_axis), float(panel.origin @ panel.row_axis)
            )
            continue
        geometry.AddProjection(
            point(source.tolist()),
            point(panel.origin.tolist()),
            vector(panel.column_axis.tolist()),
            vector(panel.row_axis.tolist()),
        )
    return geometry


def _filled(scan: Scan) -> Float32:
    def whole(p: AnyArray, measured: AnyArray) -> AnyArray:
        rows, columns = distance_transform_edt(~measured, return_distances=False, return_indices=True)
        return np.asarray(p[rows, columns])

    return np.stack([whole(p, m) for p, m in zip(line_integrals(scan), scan.mask, strict=True)]).astype(np.float32)
