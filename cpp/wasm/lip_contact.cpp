#include "wasm/lip_contact.h"
#include "linalg/partial_solve.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double no_gap = 1e-9; // of a force that opens a gap, what stands on free nodes: less of one between held ones
constexpr int batch = 48;       // gaps that are solved for together

// The gaps that something free can open, on free nodes.
void keep_open_ones(GapConstraints& out, const LipGaps& lips, const std::vector<int>& free_index) {
    out.first.push_back(0);
    for (int g = 0; g < lips.count(); g++) {
        double square = 0;
        for (int k = lips.first[g]; k < lips.first[g + 1]; k++) {
            if (free_index[lips.node[k]] < 0) continue;
            out.node.push_back(free_index[lips.node[k]]);
            out.share.insert(out.share.end(), lips.normal[k].begin(), lips.normal[k].end());
            for (double v : lips.normal[k]) square += v * v;
        }
        if (std::sqrt(square) > no_gap) {
            out.first.push_back(int(out.node.size()));
            continue;
        }
        out.node.resize(out.first.back());
        out.share.resize(3 * out.node.size());
    }
}

} // namespace

GapConstraints lip_contact(const LipGaps& lips, const SparseCholesky& factor, const std::vector<int>& free_index,
                           const std::vector<int>& vertices, bool& too_many) {
    GapConstraints out;
    keep_open_ones(out, lips, free_index);
    const int count = int(out.first.size()) - 1;
    too_many = count > GapConstraints::most;
    if (count == 0 || too_many) return {};
    out.count = out.rows = count;
    out.stride = (count + cache_line - 1) / cache_line * cache_line;
    out.rest.assign(count, 0), out.give.assign(count, 0);
    out.between.resize(size_t(count) * out.stride);
    out.response.resize(3 * vertices.size() * out.stride);

    std::vector<int> loaded = out.node;
    std::sort(loaded.begin(), loaded.end());
    loaded.erase(std::unique(loaded.begin(), loaded.end()), loaded.end());
    const auto place = [&](int node) { return std::lower_bound(loaded.begin(), loaded.end(), node) - loaded.begin(); };
    std::vector<int> wanted = loaded;
    wanted.insert(wanted.end(), vertices.begin(), vertices.end());
    std::sort(wanted.begin(), wanted.end());
    wanted.erase(std::unique(wanted.begin(), wanted.end()), wanted.end());
    const auto solved = [&](int node) { return std::lower_bound(wanted.begin(), wanted.end(), node) - wanted.begin(); };

    PartialSolve<double> partial(factor.tree, factor.value.data(), batch);
    std::vector<double> load(3 * loaded.size() * batch), moved(3 * wanted.size() * batch);
    for (int from = 0; from < count; from += batch) {
        const int used = std::min(batch, count - from);
        std::fill(load.begin(), load.end(), 0.0);
        for (int g = from; g < from + used; g++)
            for (int k = out.first[g]; k < out.first[g + 1]; k++)
                for (int d = 0; d < 3; d++)
                    load[(3 * size_t(place(out.node[k])) + d) * batch + g - from] = out.share[3 * size_t(k) + d];
        partial.solve(loaded.data(), int(loaded.size()), load.data(), wanted.data(), int(wanted.size()), moved.data(),
                      used);
        for (size_t v = 0; v < vertices.size(); v++)
            for (int d = 0; d < 3; d++)
                for (int c = 0; c < used; c++)
                    out.response[(3 * v + d) * out.stride + from + c] =
                        float(moved[(3 * size_t(solved(vertices[v])) + d) * batch + c]);
        for (int g = 0; g < count; g++)
            for (int k = out.first[g]; k < out.first[g + 1]; k++) {
                const double* at = &moved[3 * size_t(solved(out.node[k])) * batch];
                for (int d = 0; d < 3; d++)
                    for (int c = 0; c < used; c++)
                        out.between[size_t(g) * out.stride + from + c] +=
                            float(out.share[3 * size_t(k) + d] * at[d * batch + c]);
            }
    }
    for (int g = 0; g < count; g++) // symmetric but for rounding
        for (int h = 0; h < g; h++) {
            float &a = out.between[size_t(g) * out.stride + h], &b = out.between[size_t(h) * out.stride + g];
            a = b = (a + b) / 2;
        }
    return out;
}

} // namespace palpate
