"""How good a volume is: every figure of merit of the study, from the truth that was scanned."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import ndimage

from palpate.arrays import AnyArray, Bool, Float64
from palpate.scans.analytic_phantoms import Phantom
from palpate.studies.tomosynthesis.config import Setting, phantom
from palpate.volumes.image_metrics import artefact_spread, contrast_to_noise, nmse, structural_similarity, width_at_half
from palpate.volumes.volume import Volume

MARGIN = 5.0  # mm, that the region of interest keeps from the slab's walls, where few views leave the largest errors
DEPTH_MARGIN = 2.0  # mm, the same in depth
APART = 3.0  # mm between an insert and its background, that blur at its border counts for neither
AROUND = 12.0  # mm that the background reaches
BALL = 5  # part of the phantom with nothing above or below it: for the spread in depth


@dataclass(frozen=True)
class ImageQuality:
    """The truth and the regions, on the setting's grid. body: what was scanned, its first part the slab."""

    setting: Setting
    body: Phantom = field(default_factory=phantom)

    @cached_property
    def truth(self) -> Volume:
        """Attenuation, each voxel the mean over its volume."""
        return self.body.volume(self.setting.grid, 4)

    @cached_property
    def slab(self) -> Bool:
        """Inside the slab, off its walls."""
        (low, high), grid = self.body.parts[0][0].bounds(), self.setting.grid
        margins = (MARGIN, MARGIN, DEPTH_MARGIN)
        x, y, z = (
            (grid.axis(n) > low[i] + margins[i]) & (grid.axis(n) < high[i] - margins[i]) for i, n in enumerate("xyz")
        )
        box: Bool = z[:, None, None] & y[:, None] & x
        return box

    @cached_property
    def inserts(self) -> list[Bool]:
        """Voxels that lie mostly inside each insert."""
        return [Phantom([(solid, 1.0)]).volume(self.setting.grid, 3).values > 0.6 for solid, _ in self.body.parts[1:]]

    @cached_property
    def surroundings(self) -> list[Bool]:
        """For each insert the plain slab around it, in its slices."""
        spacing = self.setting.grid.spacing[1:]
        taken = np.any(self.inserts, axis=0)
        around = []
        for insert in self.inserts:
            out = np.zeros(insert.shape, bool)
            for k in np.flatnonzero(insert.any(axis=(1, 2))):
                free = ndimage.distance_transform_edt(~taken[k], sampling=spacing) > APART
                near = ndimage.distance_transform_edt(~insert[k], sampling=spacing) < AROUND
                out[k] = free & near & self.slab[k]
            around.append(out)
        return around

    @cached_property
    def region(self) -> Bool:
        """The inserts and the plain slab around them, in their slices: where a viewer would look.

        Not all of the slab: its walls and faces, of which few views see only one side, cast slow gradients over it.
        """
        inside: Bool = np.any(self.inserts, axis=0) | np.any(self.surroundings, axis=0)
        return inside

    def errors(self, values: AnyArray) -> tuple[float, float]:
        """NMSE of the full field as it is, and of the region after window and level: `nmse`, made quick for each iterate."""
        t, power = self._known
        d = (values - self.truth.values).ravel()
        x = values[self.region].astype(np.float64)
        x -= x.mean()
        inside = 1 - _dot(x, t) ** 2 / max(_dot(x, x) * _dot(t, t), np.finfo(float).tiny)
        return _dot(d, d) / power, inside

    @cached_property
    def _known(self) -> tuple[Float64, float]:
        """The truth in the region less its mean, and the full field's power."""
        t = self.truth.values[self.region].astype(np.float64)
        return t - t.mean(), float((self.truth.values.astype(np.float64) ** 2).sum())

    def spread(self, values: AnyArray) -> Float64:
        """(slices of the slab) artefact spread function of the ball, which has nothing above or below it."""
        spacing = self.setting.grid.spacing[1:]
        taken = np.any([insert.any(axis=0) for insert in self.inserts], axis=0)
        at = int(np.argmin(np.abs(self.setting.grid.axis("z") - self.body.parts[BALL][0].bounds()[:, 2].mean())))
        inside = self.inserts[BALL - 1][at]
        free = ndimage.distance_transform_edt(~taken, sampling=spacing) > APART
        near = ndimage.distance_transform_edt(~inside, sampling=spacing) < AROUND
        return artefact_spread(values, inside, free & near, at)[self.slices]

    @cached_property
    def slices(self) -> slice:
        """Those of the slab."""
        inside = np.flatnonzero(self.slab.any(axis=(1, 2)))
        return slice(int(inside[0]), int(inside[-1]) + 1)

    def similarity(self, values: AnyArray) -> float:
        """SSIM inside the slab."""
        return structural_similarity(values, self.truth.values, self.slab)

    def contrast(self, values: AnyArray) -> float:
        """Contrast to noise of the inserts, each against the plain slab around it, in the mean."""
        pairs = zip(self.inserts, self.surroundings, strict=True)
        return float(np.mean([abs(contrast_to_noise(values, a, b)) for a, b in pairs]))

    def quality(self, values: AnyArray) -> dict[str, float]:
        """Every figure of merit by name."""
        full = nmse(values, self.truth.values)
        region = nmse(values, self.truth.values, self.region, scaled=True)
        return {
            "nmse": full,
            "nmse_region": region,
            "ssim": self.similarity(values),
            "cnr": self.contrast(values),
            "depth_mm": width_at_half(self.spread(values), self.setting.grid.spacing[0]),
        }


def _dot(a: AnyArray, b: AnyArray) -> float:
    """Without BLAS, whose idle threads would spend processor time in what is timed next."""
    return float(np.einsum("i,i->", a, b, dtype=np.float64))
