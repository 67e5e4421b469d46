// A factored stiffness whose vertices are all nodes, at random positions in a box of 20 mm.
#pragma once
#include "compliance/factored_stiffness.h"
#include <numeric>
#include <random>

namespace palpate {

inline FactoredStiffness all_vertices(const SparseCholesky& factor, int nodes) {
    FactoredStiffness out{&factor.tree, &factor, factor.rounded(), std::vector<int>(nodes), {}, {}, {}, {}};
    std::iota(out.free_index.begin(), out.free_index.end(), 0);
    out.vertex_index = out.vertex_node = out.vertex_free = out.free_index;
    std::mt19937 random(3);
    std::uniform_real_distribution<double> coordinate(0, 20);
    for (int i = 0; i < 3 * nodes; i++) out.position.push_back(coordinate(random));
    return out;
}

} // namespace palpate
