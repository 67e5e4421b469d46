"""All gaps of a body: between the lips of cuts, between organs, and across attachments."""

import warnings

import numpy as np
from scipy.sparse import csr_array, hstack

from palpate.arrays import Int32
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.tissue.attachment_gaps import attachment_gaps
from palpate.tissue.gap_contact import MOST_GAPS, GapContact
from palpate.tissue.lip_gaps import lip_gaps
from palpate.tissue.organ_gaps import organ_gaps
from palpate.tissue.sparse_factor import Factors
from palpate.tissue.tissue import Tissue

NO_GAP = 1e-9  # of a force that opens a gap, what stands on free nodes: less of one between held nodes alone


def may_meet(tissue: Tissue) -> bool:
    """Whether surfaces of a tissue may meet: organs beside each other, or lips of cuts."""
    return isinstance(tissue.mesh, CutMesh) or organ_gaps(tissue.mesh)[0].shape[1] > 0


def gap_contact(tissue: Tissue, factors: Factors, vertices: Int32) -> GapContact | None:
    """The contact of a tissue; None if nothing can meet or pull. factors, vertices: as for `GapContact`.

    If there are too many gaps, those that are widest at rest are left out, with a warning. Raises `DataError` if there
    are too many of lips and attachments.
    """
    N, rest = organ_gaps(tissue.mesh)
    parts = [(N, np.maximum(rest, 0), np.zeros(len(rest)))]
    if isinstance(tissue.mesh, CutMesh):
        lips = lip_gaps(tissue.mesh)
        parts.append((lips, np.zeros(lips.shape[1]), np.zeros(lips.shape[1])))
    springs, give = attachment_gaps(tissue)
    parts.append((springs, np.zeros(len(give)), give))
    N = csr_array(hstack([part for part, _, _ in parts]))[np.repeat(~tissue.held, 3)]
    rest, give = (np.concatenate([part[k] for part in parts]) for k in (1, 2))
    opens = np.flatnonzero(np.sqrt(N.power(2).sum(axis=0)) > NO_GAP)
    if len(opens) == 0:
        return None
    if len(opens) > MOST_GAPS and np.count_nonzero(rest[opens] == 0) <= MOST_GAPS:
        opens = np.sort(opens[np.argsort(rest[opens], kind="stable")[:MOST_GAPS]])
        warnings.warn(
            f"contact: surfaces more than {rest[opens].max():.2g} mm apart at rest do not meet in this model",
            stacklevel=4,
        )
    return GapContact(factors, csr_array(N[:, opens]), rest[opens], give[opens], vertices)
