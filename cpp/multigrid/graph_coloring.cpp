#include "multigrid/graph_coloring.h"
#include <algorithm>

namespace palpate {
namespace {

// Greedy colouring: each node gets the first colour that none of its neighbours has. Within a colour, nodes with the
// same number of neighbours in earlier colours are adjacent, so that the branches of the sweeps are predicted.
std::vector<int> order_by_colour(const ElasticMesh& mesh) {
    std::vector<std::vector<int>> tets(mesh.nodes);
    for (int t = 0; t < mesh.tets; t++)
        for (int k = 0; k < 4; k++) tets[mesh.tet[4 * size_t(t) + k]].push_back(t);
    std::vector<int> colour(mesh.nodes, -1), order(mesh.nodes);
    std::vector<uint8_t> taken;
    for (int i = 0; i < mesh.nodes; i++) {
        taken.assign(taken.size() + 1, 0);
        for (int t : tets[i])
            for (int k = 0; k < 4; k++)
                if (const int c = colour[mesh.tet[4 * size_t(t) + k]]; c >= 0) {
                    if (size_t(c) >= taken.size()) taken.resize(c + 1, 0);
                    taken[c] = 1;
                }
        colour[i] = int(std::find(taken.begin(), taken.end(), 0) - taken.begin());
        taken.resize(std::min<size_t>(taken.size(), 64));
    }
    std::vector<int> before(mesh.nodes), earlier;
    for (int i = 0; i < mesh.nodes; i++) {
        earlier.clear();
        for (int t : tets[i])
            for (int k = 0; k < 4; k++)
                if (const int j = mesh.tet[4 * size_t(t) + k]; colour[j] < colour[i] && !mesh.fixed[j])
                    earlier.push_back(j);
        std::sort(earlier.begin(), earlier.end());
        before[i] = mesh.fixed[i] ? 0 : int(std::unique(earlier.begin(), earlier.end()) - earlier.begin());
    }
    for (int i = 0; i < mesh.nodes; i++) order[i] = i;
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
        return colour[a] != colour[b] ? colour[a] < colour[b] : before[a] < before[b];
    });
    return order;
}

} // namespace

ColoredMesh::ColoredMesh(const ElasticMesh& given)
    : order(order_by_colour(given)), internal_index(given.nodes), mesh(given) {
    for (int k = 0; k < given.nodes; k++) {
        const int i = order[k];
        internal_index[i] = k;
        node.insert(node.end(), given.node + 3 * size_t(i), given.node + 3 * size_t(i) + 3);
        fixed.push_back(given.fixed[i]);
    }
    for (size_t k = 0; k < 4 * size_t(given.tets); k++) tet.push_back(internal_index[given.tet[k]]);
    mesh.node = node.data(), mesh.tet = tet.data(), mesh.fixed = fixed.data();
}

} // namespace palpate
