"""What an attachment pulls on, as gaps of the body."""

import numpy as np
from scipy.sparse import csr_array

from palpate.arrays import Float64
from palpate.errors import DataError, MaterialError
from palpate.tissue.contact_patches import patch
from palpate.tissue.tissue import Tissue


def attachment_gaps(tissue: Tissue) -> tuple[csr_array, Float64]:
    """(3N, 3a) and (3a,) mm/N: of each attachment how far its second place has moved from the first along x, y, z, as Nᵀu,
    and how far it gives under a newton. Raises `MaterialError` for places off the surface or on held nodes alone."""
    N = np.zeros((len(tissue.mesh.nodes), len(tissue.attachments)))
    for number, one in enumerate(tissue.attachments):
        for place, sign in ((one.first, -1.0), (one.second, 1.0)):
            try:
                found = patch(tissue, place, one.radius)
            except DataError as problem:
                raise MaterialError(f"attachment {number + 1}: {problem}") from None
            N[found.nodes, number] += sign * found.weights
    give = np.repeat([1 / one.stiffness for one in tissue.attachments], 3)
    return csr_array(np.kron(N, np.eye(3))), give
