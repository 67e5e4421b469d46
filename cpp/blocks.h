#pragma once
#include "rings.h"

namespace palpate {

// The 3x3 edge blocks of a finite-element operator in the ring sweep: block Gauss-Seidel on FEM, exact in the limit.
class Blocks : public RingModel {
public:
    // K in block rows: start (nodes + 1), column and block (start[nodes]) and (start[nodes], 3, 3) N/mm, every diagonal
    // block present. held: (nodes), 1 where the node stands still. 0 < relaxation < 2. modes: empty for bare sweeps.
    Blocks(const int32_t* start, const int32_t* column, const double* block, int nodes, std::vector<uint8_t> held,
           double relaxation, Modes modes);
    void internal_force(const State& state, double* out) const override;

private:
    std::vector<double> block;    // off the diagonal: (edges, 3 columns, 4), the fourth entry 0 so that columns align
    std::vector<double> diagonal; // (nodes, 3, 3)
    std::vector<double> inverse;  // (nodes, 3, 3)
    const Modes modes;
    void prepare(RingState&) const override {}
    void touched_matrix(RingState& s, double* A) const override;
    void touched_right(RingState& s) const override;
    void relax(RingState& s, int first) const override;
    double weighed(const RingState& s, int node, const double r[3]) const override;
    bool stiffness_follows_weights() const override { return false; }
    void bind(RingState& s) const override;
    void settle(RingState& s) const override;
};

} // namespace palpate
