// Elimination tree and layout of a sparse factor. Made by linalg/sparse_cholesky.cpp; constant, read by any thread.
#pragma once
#include "linalg/nested_dissection.h"

namespace palpate {

// The factor's numbers. Supernode s has its own panels first (panel p: columns 0 .. 8p + 7 of 8 rows, whose last tile,
// on the diagonal, is stored inverted), then the panels below (all its columns), each column by column: a substitution
// reads them in order.
template <class T> using FactorValues = std::vector<T, CacheAlignedAllocator<T>>;

// Where the factor of a matrix of 3x3 node blocks has entries: its columns in supernodes, each a run of nodes that are
// eliminated as one dense front. A supernode's rows lie in its ancestors: that is what makes sparse solves cheap.
struct Supernodes {
    Supernodes() = default; // of no nodes
    Supernodes(const SparsityPattern& pattern, Dissection dissection);

    static constexpr int panel = 8; // unknowns of a front are padded to a multiple of this

    int count() const { return int(parent.size()); }
    int nodes() const { return int(order.size()); }
    int own(int s) const { return 3 * (first[s + 1] - first[s]); } // unknowns
    int below(int s) const { return int(3 * (row_start[s + 1] - row_start[s])); }
    int own_panels(int s) const { return (own(s) + panel - 1) / panel; }
    int below_panels(int s) const { return (below(s) + panel - 1) / panel; }
    double work(int s) const; // floating-point operations of its front, about
    // Numbers kept of its columns: triangles of its own panels, then rectangles of those below.
    int64_t entries(int s) const;

    std::vector<int> order, place;    // the node at each place of the elimination, and the place of each node
    std::vector<int> first;           // (count + 1) places
    std::vector<int> part;            // (nodes) supernode of each place
    std::vector<int> parent;          // (count) or -1
    std::vector<int64_t> row_start;   // (count + 1)
    std::vector<int> row;             // places of the nodes below, rising
    std::vector<int64_t> index_start; // (count + 1)
    std::vector<int> index;           // unknowns below (3 place + k), padded to whole panels with 3 nodes()
    std::vector<int64_t> entry_start; // (count + 1)

    // Rising list of the supernodes that hold `places` and all their ancestors: all that a substitution needs to visit
    // for a right-hand side, or for a solution, on these nodes. mark: (count) zeros, left so. Allocates only in `out`.
    void paths(const int* places, int size, std::vector<uint8_t>& mark, std::vector<int>& out) const;
};

} // namespace palpate
