#include "elements/smoothed_stiffness.h"
#include "tissue/tetrahedron.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <tuple>

namespace palpate {
namespace {

struct Slopes { // gradients of a tetrahedron's shape functions, 1/mm
    double of[4][3];
};

struct Entry { // of one shape function's mean gradient in one cell
    int cell, node;
    double gradient[3];
};

// The mean gradients of all shape functions in all cells, times the root of the cell's volume and constant: sorted by
// cell and node, one entry for each pair.
struct Gradients {
    std::vector<Entry> entries;
    std::vector<size_t> start;              // (cells + 1)
    std::vector<std::vector<int>> cells_of; // (nodes)
    void add(std::vector<Entry> parts, int nodes) {
        std::sort(parts.begin(), parts.end(),
                  [](const Entry& a, const Entry& b) { return std::tie(a.cell, a.node) < std::tie(b.cell, b.node); });
        for (const Entry& part : parts) {
            if (entries.empty() || entries.back().cell != part.cell) start.push_back(entries.size());
            if (!entries.empty() && entries.back().cell == part.cell && entries.back().node == part.node)
                for (int k = 0; k < 3; k++) entries.back().gradient[k] += part.gradient[k];
            else
                entries.push_back(part);
        }
        start.push_back(entries.size());
        cells_of.resize(nodes);
        for (const Entry& entry : entries) cells_of[entry.node].push_back(entry.cell);
    }
};

// Numbers from 0 for the keys, in their order.
template <class Key> std::vector<int> numbered(const std::vector<Key>& keys) {
    std::vector<Key> sorted = keys;
    std::sort(sorted.begin(), sorted.end());
    sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
    std::vector<int> out;
    for (const Key& key : keys)
        out.push_back(int(std::lower_bound(sorted.begin(), sorted.end(), key) - sorted.begin()));
    return out;
}

// cells: (tets, each) of every tetrahedron, which gives `share` of its volume to each. harmonic: the constant of a cell
// is the harmonic mean of its parts', else the arithmetic one.
Gradients gradients(const ElasticSolid& solid, const std::vector<Slopes>& slopes, const std::vector<double>& volumes,
                    const std::vector<int>& cells, int each, double share, const double* constant, bool harmonic) {
    const int count = cells.empty() ? 0 : *std::max_element(cells.begin(), cells.end()) + 1;
    std::vector<double> volume(count), sum(count);
    for (int t = 0; t < solid.tets; t++)
        for (int i = 0; i < each; i++) {
            const int cell = cells[size_t(each) * t + i];
            volume[cell] += share * volumes[t];
            sum[cell] += share * volumes[t] * (harmonic ? 1 / constant[t] : constant[t]);
        }
    std::vector<Entry> parts;
    parts.reserve(size_t(4) * each * solid.tets);
    for (int t = 0; t < solid.tets; t++)
        for (int i = 0; i < each; i++) {
            const int cell = cells[size_t(each) * t + i];
            const double mean = harmonic ? volume[cell] / sum[cell] : sum[cell] / volume[cell];
            const double weight = share * volumes[t] * std::sqrt(mean / volume[cell]);
            for (int c = 0; c < 4; c++) {
                const double* g = slopes[t].of[c];
                parts.push_back({cell, solid.tet[4 * size_t(t) + c], {weight * g[0], weight * g[1], weight * g[2]}});
            }
        }
    Gradients out;
    out.add(std::move(parts), solid.nodes);
    return out;
}

} // namespace

BlockCsr smoothed_stiffness(const ElasticSolid& solid, const std::vector<int>& free_index) {
    std::vector<Slopes> slopes(solid.tets);
    std::vector<double> volumes(solid.tets);
    std::vector<std::array<int, 3>> edge_keys;
    std::vector<std::array<int, 2>> node_keys;
    for (int t = 0; t < solid.tets; t++) {
        const int32_t* corner = solid.tet + 4 * size_t(t);
        auto& g = slopes[t].of;
        volumes[t] = shape_gradients(solid.node, corner, g + 1);
        for (int k = 0; k < 3; k++) g[0][k] = -g[1][k] - g[2][k] - g[3][k];
        for (int a = 0; a < 4; a++) {
            node_keys.push_back({solid.region[t], corner[a]});
            for (int b = a + 1; b < 4; b++)
                edge_keys.push_back({solid.region[t], std::min(corner[a], corner[b]), std::max(corner[a], corner[b])});
        }
    }
    const Gradients shear = gradients(solid, slopes, volumes, numbered(edge_keys), 6, 1.0 / 6, solid.mu, false);
    const Gradients bulk = gradients(solid, slopes, volumes, numbered(node_keys), 4, 0.25, solid.lam, true);

    BlockCsr K;
    std::vector<int> place(solid.nodes, -1), row; // of each node in the row; the nodes of the row
    for (int i = 0; i < solid.nodes; i++) {
        if (free_index[i] < 0) continue;
        row.clear();
        for (int cell : bulk.cells_of[i]) // the cells of a node hold those of its edges
            for (size_t e = bulk.start[cell]; e < bulk.start[cell + 1]; e++) {
                const int j = bulk.entries[e].node;
                if (free_index[j] >= 0 && place[j] < 0) place[j] = 0, row.push_back(j);
            }
        std::sort(row.begin(), row.end());
        const size_t first = K.column.size();
        for (size_t n = 0; n < row.size(); n++) place[row[n]] = int(n), K.column.push_back(free_index[row[n]]);
        K.block.resize(9 * K.column.size());
        const auto each = [&](const Gradients& all, const auto& add) {
            for (int cell : all.cells_of[i]) {
                const Entry *from = &all.entries[all.start[cell]], *to = from + (all.start[cell + 1] - all.start[cell]);
                const Entry* mine =
                    std::lower_bound(from, to, i, [](const Entry& e, int node) { return e.node < node; });
                for (const Entry* other = from; other < to; other++)
                    if (free_index[other->node] >= 0)
                        add(mine->gradient, other->gradient, &K.block[9 * (first + place[other->node])]);
            }
        };
        each(shear, [](const double* g, const double* h, double* out) { // mu (h g' + g.h 1)
            const double dot = g[0] * h[0] + g[1] * h[1] + g[2] * h[2];
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) out[3 * a + b] += h[a] * g[b] + (a == b ? dot : 0);
        });
        each(bulk, [](const double* g, const double* h, double* out) { // lam g h'
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) out[3 * a + b] += g[a] * h[b];
        });
        for (int j : row) place[j] = -1;
        K.start.push_back(int(K.column.size()));
    }
    return K;
}

} // namespace palpate
