"""All gaps of a body: between the lips of cuts, between organs, and across attachments."""

import warnings

import numpy as np
from scipy.sparse import csr_array

from palpate.arrays import Int32
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.tissue.attachment_gaps import attachment_gaps
from palpate.tissue.gap_contact import MOST_GAPS, GapContact
from palpate.tissue.lip_gaps import lip_gaps
from palpate.tissue.organ_gaps import organ_gaps
from palpate.tissue.sparse_factor import Factors
from palpate.tissue.surface_gaps import SurfaceGaps
from palpate.tissue.tissue import Tissue

NO_GAP = 1e-9  # of a force that opens a gap, what stands on free nodes: less of one between held nodes alone


def may_meet(tissue: Tissue) -> bool:
    """Whether surfaces of a tissue may meet: organs beside each other, or lips of cuts."""
    return isinstance(tissue.mesh, CutMesh) or len(organ_gaps(tissue.mesh).rest) > 0


def gap_contact(tissue: Tissue, factors: Factors, vertices: Int32) -> GapContact | None:
    """The contact of a tissue; None if nothing can meet or pull. factors, vertices: as for `GapContact`.

    If there are too many gaps, those that are widest at rest are left out, with a warning. Raises `DataError` if there
    are too many of lips and attachments.
    """
    rubs = tissue.surface_friction > 0
    parts = [organ_gaps(tissue.mesh, slips=rubs)]
    if isinstance(tissue.mesh, CutMesh):
        parts.append(lip_gaps(tissue.mesh, slips=rubs))
    springs, stretch = attachment_gaps(tissue)
    parts.append(SurfaceGaps(springs, np.zeros(len(stretch)), csr_array((springs.shape[0], 2 * rubs * len(stretch)))))
    every = SurfaceGaps.together(parts)
    give = np.concatenate([np.zeros(len(every.rest) - len(stretch)), stretch])
    free = np.repeat(~tissue.held, 3)
    N, rest, T = every.N[free], np.maximum(every.rest, 0), every.T[free]
    opens = np.flatnonzero(np.sqrt(N.power(2).sum(axis=0)) > NO_GAP)
    if len(opens) == 0:
        return None
    if len(opens) > MOST_GAPS and np.count_nonzero(rest[opens] == 0) <= MOST_GAPS:
        opens = np.sort(opens[np.argsort(rest[opens], kind="stable")[:MOST_GAPS]])
        warnings.warn(
            f"contact: surfaces more than {rest[opens].max():.2g} mm apart at rest do not meet in this model",
            stacklevel=4,
        )
    slips = (2 * opens[:, None] + np.arange(2 * rubs)).ravel()
    found = SurfaceGaps(csr_array(N[:, opens]), rest[opens], csr_array(T[:, slips]))
    return GapContact(factors, found, give[opens], tissue.surface_friction, vertices)
