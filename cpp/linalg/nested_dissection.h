// Order of elimination by nested dissection (A. George, SIAM J. Numer. Anal. 10 (1973) 345). Called by
// linalg/sparse_cholesky.cpp, on one thread.
#pragma once
#include "linalg/block_csr.h"

namespace palpate {

// An order of elimination, and the parts of it that are eliminated as one.
struct Dissection {
    std::vector<int> order; // (nodes) the node that is eliminated first, second, ...
    std::vector<int> first; // (parts + 1) where in `order` each part begins
};

// Nested dissection of space: a plane cuts the nodes in two, both halves come first, the cut last; so on down to `leaf`
// nodes. A cut is the smallest set of nodes that touches every edge between the halves (a vertex cover, by Konig's
// theorem from a maximum matching). Of planes in several directions the one with the smallest cut is taken, the larger
// half counted against it. places: (nodes, 3).
Dissection dissect(const SparsityPattern& pattern, const double* places, int leaf);

} // namespace palpate
