"""`--report`: the figures of a reconstruction as a JSON file, for tables of many."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import palpate as pp

if TYPE_CHECKING:
    from palpate.reconstruction.residuals import Residuals


def report_figures(
    scan: "pp.Scan", last: "pp.Step", found: "Sequence[pp.Finding]", left: "Residuals | None"
) -> dict[str, Any]:
    """The figures by name: geometry, what the checks found, the prior's strength, the fit.

    left: of the views that the volume does not explain; none if that was not asked.
    """
    import numpy as np

    grid, views = last.volume.grid, scan.views
    heights = [
        float(abs(np.dot(source - panel.origin, np.cross(panel.row_axis, panel.column_axis))))
        for source, panel in zip(views.source, views.panels, strict=True)
    ]
    figures: dict[str, Any] = {
        "views": len(views),
        "rows": scan.counts.shape[1],
        "columns": scan.counts.shape[2],
        "pitch_mm": "x".join(f"{pitch:g}" for pitch in views.panels[0].pitch),
        "source_to_panel_mm": round(float(np.mean(heights)), 3),
        "voxels": "x".join(str(n) for n in grid.shape),
        "spacing_mm": "x".join(f"{step:g}" for step in grid.spacing),
        "check": "; ".join(str(finding) for finding in found) or "nothing found",
        "objective": last.objective,
        "iterations": last.iteration,
        "reconstruction_s": last.seconds,
    }
    if last.prior is not None:
        prior = {name: value for name, value in asdict(last.prior).items() if isinstance(value, float | int | str)}
        figures |= {f"prior_{name}": value for name, value in prior.items()}
    if left is not None:
        figures["deviance"] = float(left.deviance.mean())
        figures["unexplained"] = float(left.unexplained.max())
    return figures


def write_report(path: Path, figures: dict[str, Any]) -> None:
    """Writes them. Raises `FileError`."""
    from palpate.atomic_write import replacing

    with replacing(path) as temporary:
        temporary.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
