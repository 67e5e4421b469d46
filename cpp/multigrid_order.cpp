#include "multigrid_parts.h"
#include <algorithm>

namespace palpate {
namespace {

// By colours, no two neighbours of one: the first colour that a node's neighbours before it have left. Of one colour,
// those with as many neighbours of earlier colours stand together, so that the sweeps' branches are foreseen.
std::vector<int> by_colour(const Elements& mesh) {
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
    std::vector<int> before(mesh.nodes), near;
    for (int i = 0; i < mesh.nodes; i++) {
        near.clear();
        for (int t : tets[i])
            for (int k = 0; k < 4; k++)
                if (const int j = mesh.tet[4 * size_t(t) + k]; colour[j] < colour[i] && !mesh.held[j])
                    near.push_back(j);
        std::sort(near.begin(), near.end());
        before[i] = mesh.held[i] ? 0 : int(std::unique(near.begin(), near.end()) - near.begin());
    }
    for (int i = 0; i < mesh.nodes; i++) order[i] = i;
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
        return colour[a] != colour[b] ? colour[a] < colour[b] : before[a] < before[b];
    });
    return order;
}

} // namespace

Multigrid::Ordered::Ordered(const Elements& given) : order(by_colour(given)), inside(given.nodes), mesh(given) {
    for (int k = 0; k < given.nodes; k++) {
        const int i = order[k];
        inside[i] = k;
        node.insert(node.end(), given.node + 3 * size_t(i), given.node + 3 * size_t(i) + 3);
        held.push_back(given.held[i]);
    }
    for (size_t k = 0; k < 4 * size_t(given.tets); k++) tet.push_back(inside[given.tet[k]]);
    mesh.node = node.data(), mesh.tet = tet.data(), mesh.held = held.data();
}

} // namespace palpate
