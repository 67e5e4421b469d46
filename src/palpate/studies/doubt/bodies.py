"""A random breast with one stiff lump, its scan, and what a reader marks."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Float32, Float64
from palpate.reconstruction.projector import Projector
from palpate.scans.scan import Scan
from palpate.studies.detection.acquisition import effective_attenuation
from palpate.studies.detection.breast import Breast, random_breast
from palpate.studies.detection.config import GAP
from palpate.studies.doubt.config import (
    BODY,
    CONTRASTS,
    COVER,
    DEPTHS,
    DIAMETERS,
    FRONT,
    INNER,
    LOPSIDED,
    LUMP,
    MARK,
    Setting,
)
from palpate.tissue.named_tissues import tissue_properties
from palpate.tissue.stiffness_draws import log_normal
from palpate.volumes.ellipsoid_shares import ellipsoid_shares

TRIES = 1000


@dataclass(frozen=True, eq=False)
class Body:
    """breast: its texture. values: (z, y, x) attenuation with the lump, 1/mm. shares: of the lump in each voxel.

    centre, radii: (3,) mm of the lump, an ellipsoid. contrast: lump less fat over gland less fat. young: kPa of the lump
    and of the rest. scan: with noise. mark: (x, y) mm, what a reader marks.
    """

    breast: Breast
    values: Float32
    shares: Float32
    centre: Float64
    radii: Float64
    contrast: float
    young: tuple[float, float]
    scan: Scan
    mark: Float64

    @property
    def diameter(self) -> float:
        """mm, of the ball of the lump's volume."""
        return 2 * float(np.cbrt(np.prod(self.radii)))


def random_body(seed: int, setting: Setting) -> Body:
    """All of a seed."""
    rng = np.random.default_rng([seed, *b"doubt"])
    kind = setting.kind
    breast = random_breast(kind, setting.fine, rng)
    axes = np.exp(rng.normal(0, LOPSIDED, 3))
    radii = rng.uniform(*DIAMETERS) / 2 * axes / np.cbrt(axes.prod())
    contrast = float(rng.uniform(*CONTRASTS))
    centre = _place(radii, setting, rng)
    shares = ellipsoid_shares(breast.grid, centre, radii)
    mu = effective_attenuation(kind)
    fat, gland = mu["adipose"], mu["glandular"]
    texture = (1 - shares) * breast.gland + shares * np.float32(contrast)
    values = (breast.tissue * (fat + (gland - fat) * texture)).astype(np.float32)
    views = setting.views
    mean = setting.incident * np.exp(-Projector(views, breast.grid)(values).astype(np.float64))
    scan = Scan(rng.poisson(mean).astype(np.float32), setting.incident, views)
    made = []
    for name in (LUMP, BODY):
        young = tissue_properties(name).young
        assert young is not None
        middle, spread = log_normal(name, young)
        made.append(float(np.exp(middle + spread * rng.standard_normal())))
    mark = centre[:2] + rng.normal(0, MARK, 2)
    return Body(breast, values, shares, centre, radii, contrast, (made[0], made[1]), scan, mark)


def _place(radii: Float64, setting: Setting, rng: np.random.Generator) -> Float64:
    """(3,) mm: below the upper plate by a random depth, at a random place of the inner part."""
    kind = setting.kind
    depth = rng.uniform(radii[2] + COVER, DEPTHS)
    for _ in range(TRIES):
        x, y = rng.uniform(-kind.across, kind.across), rng.uniform(FRONT, kind.out)
        if (x / kind.across) ** 2 + (y / kind.out) ** 2 < INNER:
            return np.array([x, y, GAP + kind.thick - depth])
    raise AssertionError("no place for a lump in the breast")
