// Forward and backward substitution with a sparse factor. One for each thread: used by SparseCholesky::solve,
// PartialSolve and compliance/.
#pragma once
#include "linalg/supernodes.h"

namespace palpate {

struct Triangle;

// Solves with a factor: L y = b along rising supernodes, L' x = y along falling ones, for one column or for groups of
// eight at once, in double or single precision. The right-hand side and the solution are in the order of elimination.
// Where the right-hand side is zero but on a few nodes, `forward` needs only their paths (Supernodes::paths); where the
// solution is wanted on a few nodes only, `backward` needs only theirs. x must be zero on all that either visits, but
// for the right-hand side. Sized once: no solve allocates.
template <class T> class TriangularSolve {
public:
    TriangularSolve(const Supernodes& tree, int columns); // the most: 1, or a multiple of 8

    std::vector<T, CacheAlignedAllocator<T>> x; // one column: (unknowns + 3); groups: (groups, unknowns + 3, 8)
    int groups;                                 // in use
    T* of(int group, int unknown) { return place<8>(group, unknown); }

    // list: rising numbers of the supernodes to visit. value: the factor.
    void forward(const T* value, const int* list, int count);
    void backward(const T* value, const int* list, int count);
    void clear(const int* list, int count); // zeros of all groups on these supernodes, one column likewise

private:
    const Supernodes& tree;
    const int columns, stride;
    std::vector<T, CacheAlignedAllocator<T>> own, below; // of the supernode at hand
    std::vector<T, CacheAlignedAllocator<T>> sums;       // for one column: backward_one's

    // wide: the columns side by side, 8 or, for one column, 1.
    template <int wide> T* place(int group, int unknown) { return &x[wide * (size_t(group) * stride + unknown)]; }
    template <int wide> Triangle gather(int supernode); // fills own and below from x
    template <int wide> void scatter_own(int supernode, const Triangle& size);
    template <int wide> void go_down(const T* value, const int* list, int count);
    template <int wide> void go_up(const T* value, const int* list, int count);
};

} // namespace palpate
