// Solves with a factor for loads on a few nodes and solutions wanted on a few. One for each thread that solves: used by
// compliance/ and hyperelastic/, in the loop and ahead of it.
#pragma once
#include "linalg/triangular_solve.h"

namespace palpate {

// Solves for loads on a few nodes and solutions wanted on a few: the way down visits only the loaded nodes' paths to
// the root of the elimination tree, the way up only the wanted nodes'. Sized once: no solve allocates. A column's bits
// depend neither on the other columns nor on what else is wanted.
template <class T> class PartialSolve {
public:
    // columns: right-hand sides at a time, a multiple of 8. The tree and the factor must outlive this.
    PartialSolve(const Supernodes& tree, const T* value, int columns);

    // load: (3 size, columns) on the unknowns of `nodes`, each named once; out: (3 count, columns) on those of
    // `wanted`.
    // Only the first `used` columns are looked at; the others of out have no meaning.
    void solve(const int* nodes, int size, const T* load, const int* wanted, int count, T* out, int used);

    const int columns;

private:
    const Supernodes& tree;
    const T* value;
    std::vector<int> path, needed, spots;
    std::vector<uint8_t> mark;
    TriangularSolve<T> substitution;
    void find_paths(const int* nodes, int size, std::vector<int>& out);
};

} // namespace palpate
