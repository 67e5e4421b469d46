"""The error of a tissue's springs against finite elements."""

import html
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from palpate.arrays import Float64


@dataclass(frozen=True, eq=False)
class FitReport:
    """Springs against finite elements on C contacts that the fit never saw.

    element: of the truth. radius, depth: mm, of every contact. points: (C, 3) mm. push: (C, 3) mm given to each: the
    first half along the inward normal, the rest 45° to it. worst: (C,) mm, greatest nodal difference of displacement.
    rms: (C,) mm, over the nodes. truth_force, spring_force: (C, 3) N of the tissue on the tool. error_map: (N,) mm,
    each node's greatest difference over the contacts.
    """

    element: str
    radius: float
    depth: float
    points: Float64
    push: Float64
    worst: Float64
    rms: Float64
    truth_force: Float64
    spring_force: Float64
    error_map: Float64

    @property
    def force_error(self) -> Float64:
        """(C,) difference of force relative to the truth's."""
        gap = np.linalg.norm(self.spring_force - self.truth_force, axis=1)
        return np.asarray(gap / np.linalg.norm(self.truth_force, axis=1))

    def text(self) -> str:
        """The figures as lines for people."""
        half = (len(self.points) + 1) // 2
        lines = [f"springs against linear finite elements ({self.element}), pushes of {self.depth:.3g} mm, "
                 f"patch radius {self.radius:.3g} mm, contacts not used in the fit:"]  # fmt: skip
        for name, part in (("along the normal", slice(None, half)), ("at 45 degrees", slice(half, None))):
            worst, rms, force = self.worst[part], self.rms[part], self.force_error[part]
            if len(worst):
                lines.append(
                    f"  {len(worst):2d} {name:>16}: displacement worst {worst.max():.2f} mm "
                    f"({100 * worst.max() / self.depth:.0f} % of the push), RMS {np.sqrt((rms**2).mean()):.2f} mm; "
                    f"force off by {100 * np.sqrt((force**2).mean()):.0f} % (worst {100 * force.max():.0f} %)"
                )
        if self.worst.max() > 0.5 * self.depth:
            lines.append(
                "  the springs are far off: hold more of the organ (--depth), or leave them; no other model uses them"
            )
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.text())}</pre>"

    def plain(self) -> dict[str, Any]:
        """For JSON, without the map, which is a field of its own."""
        return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in asdict(self).items() if k != "error_map"}

    @classmethod
    def from_plain(cls, plain: dict[str, Any], error_map: Float64) -> "FitReport":
        """The inverse of `plain`."""
        arrays: dict[str, Any] = {k: np.array(v) if isinstance(v, list) else v for k, v in plain.items()}
        return cls(**arrays, error_map=error_map)
