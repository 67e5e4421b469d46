#pragma once
#include "substitution.h"

namespace palpate {

// Solves for loads on a few nodes and solutions wanted on a few: the way down visits only the loaded nodes' paths to
// the root of the elimination tree, the way up only the wanted nodes'. Sized once: no solve allocates.
template <class T> class PartialSolve {
public:
    // wanted: nodes. columns: right-hand sides at a time, a multiple of 8. The tree and the factor must outlive this.
    PartialSolve(const Supernodes& tree, const T* value, std::vector<int> wanted, int columns);

    // load: (3 size, columns) on the unknowns of `nodes`, each named once; out: (3 wanted, columns).
    void solve(const int* nodes, int size, const T* load, T* out);

    // Only L^-1 load. The unknowns of supernodes in `path` then hold it, in of(); all others are zero.
    void forward(const int* nodes, int size, const T* load);
    std::vector<int> path; // supernodes that the last load reached, rising
    const T* of(int group, int unknown) { return substitution.of(group, unknown); }

private:
    const Supernodes& tree;
    const T* value;
    const int columns;
    const std::vector<int> wanted;
    std::vector<int> needed; // supernodes on the wanted nodes' paths
    std::vector<int> spots;
    std::vector<uint8_t> mark;
    Substitution<T> substitution;
};

} // namespace palpate
