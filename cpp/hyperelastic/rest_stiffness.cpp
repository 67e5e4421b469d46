#include "hyperelastic/rest_stiffness.h"
#include <algorithm>
#include <cmath>
#include <numeric>

namespace palpate {

RestStiffness::RestStiffness(const Supernodes& tree, const float* value, const std::vector<int>& free_nodes, int nodes)
    : tree(tree), value(value), free_nodes(free_nodes), nodes(nodes), free_index(nodes, -1), supernodes(tree.count()),
      rows(tree.nodes()), single(tree, 1), group(tree, 8), partial(tree, value, 8), loaded(ContactPatch::capacity),
      load(3 * 8 * ContactPatch::capacity), solution(3 * 8 * size_t(tree.nodes())) {
    for (size_t k = 0; k < free_nodes.size(); k++) free_index[free_nodes[k]] = int(k);
    std::iota(supernodes.begin(), supernodes.end(), 0);
    std::iota(rows.begin(), rows.end(), 0);
}

void RestStiffness::solve(const double* load, double* out) {
    double largest = 0; // scales the load to 1, since float32 underflows at 1e-38
    for (int i = 0; i < 3 * nodes; i++) largest = std::max(largest, std::abs(load[i]));
    const double scale = largest > 0 ? 1 / largest : 0;
    for (size_t k = 0; k < free_nodes.size(); k++)
        for (int c = 0; c < 3; c++)
            single.x[3 * tree.place[k] + c] = float(scale * load[3 * size_t(free_nodes[k]) + c]);
    single.forward(value, supernodes.data(), int(supernodes.size()));
    single.backward(value, supernodes.data(), int(supernodes.size()));
    std::fill_n(out, 3 * size_t(nodes), 0.0);
    for (size_t k = 0; k < free_nodes.size(); k++)
        for (int c = 0; c < 3; c++) out[3 * size_t(free_nodes[k]) + c] = largest * single.x[3 * tree.place[k] + c];
}

void RestStiffness::solve_three(const double* load, double* out) {
    const size_t n = 3 * size_t(nodes);
    double scale[3];
    group.clear(supernodes.data(), int(supernodes.size()));
    for (int j = 0; j < 3; j++) {
        double largest = 0;
        for (size_t i = 0; i < n; i++) largest = std::max(largest, std::abs(load[j * n + i]));
        scale[j] = largest;
        const double inverse = largest > 0 ? 1 / largest : 0;
        for (size_t k = 0; k < free_nodes.size(); k++)
            for (int c = 0; c < 3; c++)
                group.of(0, 3 * tree.place[k] + c)[j] = float(inverse * load[j * n + 3 * size_t(free_nodes[k]) + c]);
    }
    group.forward(value, supernodes.data(), int(supernodes.size()));
    group.backward(value, supernodes.data(), int(supernodes.size()));
    std::fill_n(out, 3 * n, 0.0);
    for (size_t k = 0; k < free_nodes.size(); k++)
        for (int c = 0; c < 3; c++) {
            const float* x = group.of(0, 3 * tree.place[k] + c);
            for (int j = 0; j < 3; j++) out[j * n + 3 * size_t(free_nodes[k]) + c] = scale[j] * x[j];
        }
}

void RestStiffness::solve_patch(const ContactPatch& patch, double* out) {
    int count = 0;
    for (int i = 0; i < patch.count; i++) {
        if (free_index[patch.node[i]] < 0) continue; // the support bears what is on a fixed node
        loaded[count] = free_index[patch.node[i]];
        std::fill_n(&load[24 * count], 24, 0.0f);
        for (int c = 0; c < 3; c++) load[24 * count + 8 * c + c] = float(patch.weight[i]);
        count++;
    }
    partial.solve(loaded.data(), count, load.data(), rows.data(), int(rows.size()), solution.data(), 3);
    std::fill_n(out, 9 * size_t(nodes), 0.0);
    for (size_t k = 0; k < free_nodes.size(); k++)
        for (int axis = 0; axis < 3; axis++)
            for (int c = 0; c < 3; c++)
                out[3 * (size_t(axis) * nodes + free_nodes[k]) + c] = solution[24 * k + 8 * c + axis];
}

} // namespace palpate
