// Sparse matrices of 3x3 node blocks in compressed sparse rows. Made when a model or a factor is made (bindings/,
// multigrid/hierarchy.cpp) and constant from then on, so that any thread may read them.
#pragma once
#include "base/aligned_buffer.h"
#include <cstdint>

namespace palpate {

// Which nodes share an entry: those of row i are column[start[i]] .. column[start[i + 1] - 1].
struct SparsityPattern {
    std::vector<int> start{0}, column;
    int nodes() const { return int(start.size()) - 1; }
};

// The whole matrix in float64. Multigrid's rows ascend and hold their diagonal block.
struct BlockCsr : SparsityPattern {
    std::vector<double> block; // (start[nodes], 3, 3)
};

// A symmetric matrix in float32: its strictly lower triangle in pairs of blocks, so that a row of two blocks is one
// vector of eight, and its diagonal. start counts pairs; column has two entries a pair, times four: where the node's
// entries begin in a vector of four floats a node.
struct HalfBlockCsr : SparsityPattern {
    HalfBlockCsr() = default;
    // excluded: (nodes) nonzero where the row and the column are left out, or null.
    HalfBlockCsr(const BlockCsr& K, const uint8_t* excluded);

    AlignedBuffer block;             // (pairs, 3 rows, 8): a row of the first block, then of the second
    AlignedBuffer diagonal, inverse; // (nodes, 3 columns, 4): each diagonal block and its inverse
};

// out = the inverse of a 3x3 block.
void invert_block(const double* block, double* out);

} // namespace palpate
