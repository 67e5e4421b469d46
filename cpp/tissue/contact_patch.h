#pragma once
// The nodes and weights of one contact. ContactSurface makes it, tissue models answer it; a plain value, any thread.
#include <algorithm>
#include <cstddef>

namespace palpate {

// A smooth contact: the weighted mean displacement sum_i weight[i] u(node[i]) is prescribed, and the tool's force is
// spread over the nodes with the same weights (the multiplier of that constraint), so the two are work-conjugate.
struct ContactPatch {
    static constexpr int capacity = 256;
    int count = 0;
    int node[capacity];
    double weight[capacity];               // sum to 1
    void copy(const ContactPatch& other) { // copies only the entries in use
        count = other.count;
        std::copy_n(other.node, count, node);
        std::copy_n(other.weight, count, weight);
    }
    // The weighted mean of `u`, (nodes, 3).
    void mean(const double* u, double out[3]) const {
        double sum[3] = {0, 0, 0};
        for (int i = 0; i < count; i++)
            for (int k = 0; k < 3; k++) sum[k] += weight[i] * u[3 * size_t(node[i]) + k];
        std::copy_n(sum, 3, out);
    }
};

} // namespace palpate
