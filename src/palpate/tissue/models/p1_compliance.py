"""Model `compliance-P1`: stands in for `compliance` while that is made."""

from scipy.sparse import csr_array

from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.reference.linear_elasticity import FiniteElements, lame
from palpate.tissue.smoothed_elements import p1_stiffness
from palpate.tissue.tissue import Tissue


class P1ComplianceModel(ComplianceModel):
    """`ComplianceModel` on P1 elements, whatever the tissue's element is.

    The factors have a fraction of the entries, so that they are made sooner. Its forces are too large, by more as ν grows;
    `estimate.mesh` of an answer says by how much. A session begins with it on a large mesh.
    """

    def _finite_elements(self, tissue: Tissue) -> FiniteElements:
        return _P1Elements(tissue, "P1")


class _P1Elements(FiniteElements):
    """The stiffness by our own kernel: made sooner than by scikit-fem, and equal but for rounding."""

    def _stiffness(self) -> csr_array:
        return csr_array(p1_stiffness(self.tissue.mesh, *lame(self.tissue.young, self.tissue.poisson)))
