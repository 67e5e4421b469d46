#pragma once
// Linear FEM by block Gauss-Seidel sweeps in the order of the rings. Simulation calls it through TissueModel, in the
// loop's thread.
#include "relaxation/ring_relaxation.h"

namespace palpate {

// Relaxes 3x3 blocks of a finite-element stiffness; converges to the direct solution.
class BlockGaussSeidel : public RingRelaxation {
public:
    // K: N/mm, every diagonal block present. fixed: (nodes) 1: cannot move. 0 < relaxation < 2. modes: may be empty.
    BlockGaussSeidel(const BlockCsr& K, std::vector<uint8_t> fixed, double relaxation, ModeDeflation modes);
    void internal_force(const ModelState& state, double* out) const override;

private:
    std::vector<double>
        block; // off the diagonal: (edges, 3 columns, 4), the fourth entry 0 so that columns are aligned
    std::vector<double> diagonal, inverse; // (nodes, 3, 3)
    const ModeDeflation modes;
    void update_stiffness(RingRelaxationState&) const override {}
    void contact_matrix(RingRelaxationState& s, double* A) const override;
    void contact_rhs(RingRelaxationState& s) const override;
    void sweep(RingRelaxationState& s, int first) const override;
    double preconditioned_norm2(const RingRelaxationState& s, int node, const double r[3]) const override;
    bool stiffness_depends_on_weights() const override { return false; }
    void set_mode_constraints(RingRelaxationState& s) const override;
    void deflate(RingRelaxationState& s) const override;
};

} // namespace palpate
