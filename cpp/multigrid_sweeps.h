#pragma once
#include "buffer.h"
#include "multigrid_lattice.h"
#include <vector>

namespace palpate {

// The lower triangle of a symmetric matrix of 3x3 blocks in float32, which is all that a sweep has to read: as a row is
// met, it is gathered from (L v) and its transpose is spread (L' v), so that one pass over half of the matrix relaxes
// and leaves the new residual. Vectors hold four floats a node, the fourth zero.
struct HalfMatrix {
    HalfMatrix() = default;
    // still: (nodes) rows and columns to leave out, or null.
    HalfMatrix(const BlockRows& K, const uint8_t* still);

    int nodes = 0;
    std::vector<int> start;   // (nodes + 1), in pairs of blocks
    std::vector<int> column;  // two a pair, times four: where the vector's entries lie
    Buffer block;             // (pairs, 3 rows, 8): a row of the first block, then of the second
    Buffer diagonal, inverse; // (nodes, 3 columns, 4)
};

// Successive over-relaxation from zero: (D/omega + L) d = r. next becomes r - K d; x takes d (first) or gains it.
void relax_forward(const HalfMatrix& K, float omega, const float* r, float* d, float* next, float* x, bool first);

// The way back, first sweep: x gains e and then d, (D/omega + L') d = r - K e. r becomes its new self less -L d, which
// the next sweep, or `finish`, adds when it reads L. spread: scratch, zero on entry.
void relax_turn(const HalfMatrix& K, float omega, const float* e, float* r, float* d, float* spread, float* x);

// Further sweeps back: d, r and x as the turn left them, and as it leaves them. spread: zero on entry.
void relax_backward(const HalfMatrix& K, float omega, float* r, float* d, float* spread, float* x);

// After the last sweep back: out = rhs - (r - L d), which is K x.
void finish(const HalfMatrix& K, const float* rhs, const float* r, const float* d, float* out);

// out = K x.
void multiply(const HalfMatrix& K, const float* x, float* out);

} // namespace palpate
