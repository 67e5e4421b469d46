#include "elements/smoothed_stiffness.h"
#include "base/thread_pool.h"
#include "tissue/tetrahedron.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace palpate {
namespace {

constexpr int64_t chunk = 64; // cells or nodes that are one task

struct Shape { // a tetrahedron's volume, mm^3, and the gradients of its shape functions, 1/mm
    double volume, slope[4][3];
};

// Where strain is averaged: cell c consists of parts of tetrahedra tet[start[c]] .. tet[start[c + 1] - 1], each of
// which gives `share` of its volume.
struct Cells {
    std::vector<int> start{0}, tet;
    double share;
    int count() const { return int(start.size()) - 1; }
};

// Of a cell that belongs to a node or an edge: the edge's other node, the region, the tetrahedron.
using Part = std::array<int, 3>;

// The mean gradients of the shape functions in each cell, times the root of its volume and constant. Those of cell c
// begin at first[c], one for each of its nodes in the order in which they are met.
struct MeanGradients {
    std::vector<int64_t> first;
    std::vector<int> count, node;
    std::vector<double> gradient;             // (entries, 3)
    std::vector<int64_t> start;               // (nodes + 1) where each node's own entries begin in
    std::vector<std::pair<int, int64_t>> own; // its cells, ascending, and its entry there
};

void in_chunks(int64_t count, const std::function<void(int64_t, int64_t, int)>& work) {
    parallel_tasks((count + chunk - 1) / chunk,
                   [&](int64_t task, int thread) { work(chunk * task, std::min(count, chunk * (task + 1)), thread); });
}

std::vector<Shape> shapes(const ElasticSolid& solid) {
    std::vector<Shape> out(solid.tets);
    in_chunks(solid.tets, [&](int64_t begin, int64_t end, int) {
        for (int64_t t = begin; t < end; t++) {
            auto& g = out[t].slope;
            out[t].volume =
                shape_gradients(solid.node, solid.tet + 4 * t, g + 1) * (solid.filled ? solid.filled[t] : 1);
            for (int k = 0; k < 3; k++) g[0][k] = -g[1][k] - g[2][k] - g[3][k];
        }
    });
    return out;
}

// each: calls its argument with (node, part) for all parts of all cells. A cell belongs to its first node.
template <class Each> Cells gathered(int nodes, double share, const Each& each) {
    std::vector<int> start(nodes + 1);
    each([&](int node, const Part&) { start[node + 1]++; });
    std::partial_sum(start.begin(), start.end(), start.begin());
    std::vector<Part> parts(start.back());
    std::vector<int> end(start.begin(), start.end() - 1);
    each([&](int node, const Part& part) { parts[end[node]++] = part; });
    in_chunks(nodes, [&](int64_t begin, int64_t stop, int) {
        for (int64_t i = begin; i < stop; i++) std::sort(&parts[0] + start[i], &parts[0] + start[i + 1]);
    });
    Cells out;
    out.share = share;
    out.tet.reserve(parts.size());
    for (int i = 0; i < nodes; i++)
        for (int k = start[i]; k < start[i + 1]; k++) {
            const bool same = k > start[i] && parts[k][0] == parts[k - 1][0] && parts[k][1] == parts[k - 1][1];
            if (k > start[i] && !same) out.start.push_back(k);
            out.tet.push_back(parts[k][2]);
            if (k + 1 == start[i + 1]) out.start.push_back(k + 1);
        }
    return out;
}

Cells cells_of_edges(const ElasticSolid& solid) {
    return gathered(solid.nodes, 1.0 / 6, [&](const auto& take) {
        for (int t = 0; t < solid.tets; t++)
            for (int a = 0; a < 4; a++)
                for (int b = a + 1; b < 4; b++) {
                    const auto [low, high] = std::minmax(solid.tet[4 * size_t(t) + a], solid.tet[4 * size_t(t) + b]);
                    take(low, Part{high, solid.region[t], t});
                }
    });
}

Cells cells_of_nodes(const ElasticSolid& solid) {
    return gathered(solid.nodes, 0.25, [&](const auto& take) {
        for (int t = 0; t < solid.tets; t++)
            for (int a = 0; a < 4; a++) take(solid.tet[4 * size_t(t) + a], Part{0, solid.region[t], t});
    });
}

Cells cells_of_tetrahedra(const ElasticSolid& solid) {
    Cells out;
    out.share = 1;
    out.start.resize(solid.tets + 1);
    out.tet.resize(solid.tets);
    std::iota(out.start.begin(), out.start.end(), 0);
    std::iota(out.tet.begin(), out.tet.end(), 0);
    return out;
}

// harmonic: the constant of a cell is the harmonic mean of its parts', else the arithmetic one.
MeanGradients mean_gradients(const ElasticSolid& solid, const std::vector<Shape>& shape, const Cells& cells,
                             const double* constant, bool harmonic) {
    MeanGradients out;
    out.count.resize(cells.count());
    for (int start : cells.start) out.first.push_back(4 * int64_t(start)); // as if no two parts had a common node
    out.node.resize(out.first.back());
    out.gradient.resize(3 * out.node.size());
    in_chunks(cells.count(), [&](int64_t begin, int64_t end, int) {
        for (int64_t c = begin; c < end; c++) {
            int* node = &out.node[out.first[c]];
            double* gradient = &out.gradient[3 * out.first[c]];
            int& count = out.count[c];
            double volume = 0, sum = 0;
            for (int k = cells.start[c]; k < cells.start[c + 1]; k++) {
                const int t = cells.tet[k];
                const double part = cells.share * shape[t].volume;
                volume += part;
                sum += harmonic ? part / constant[t] : part * constant[t];
                for (int a = 0; a < 4; a++) {
                    const int here = solid.tet[4 * size_t(t) + a];
                    const int at = int(std::find(node, node + count, here) - node);
                    if (at == count) node[count++] = here;
                    for (int d = 0; d < 3; d++) gradient[3 * at + d] += part * shape[t].slope[a][d];
                }
            }
            const double root = std::sqrt((harmonic ? volume / sum : sum / volume) / volume);
            for (int k = 0; k < 3 * count; k++) gradient[k] *= root;
        }
    });
    out.start.resize(solid.nodes + 1);
    for (int c = 0; c < cells.count(); c++)
        for (int k = 0; k < out.count[c]; k++) out.start[out.node[out.first[c] + k] + 1]++;
    std::partial_sum(out.start.begin(), out.start.end(), out.start.begin());
    std::vector<int64_t> end(out.start.begin(), out.start.end() - 1);
    out.own.resize(out.start.back());
    for (int c = 0; c < cells.count(); c++)
        for (int k = 0; k < out.count[c]; k++) {
            const int64_t entry = out.first[c] + k;
            out.own[end[out.node[entry]]++] = {c, entry};
        }
    return out;
}

void add_shear(const double* g, const double* h, double* out) { // mu (h g' + g.h 1)
    const double dot = g[0] * h[0] + g[1] * h[1] + g[2] * h[2];
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) out[3 * a + b] += a == b ? h[a] * g[b] + dot : h[a] * g[b];
}

void add_bulk(const double* g, const double* h, double* out) { // lam g h'
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) out[3 * a + b] += g[a] * h[b];
}

// The cells of the dilatation at a node hold those of its shear.
BlockCsr assembled(const MeanGradients& shear, const MeanGradients& bulk, const std::vector<int>& free_index) {
    const int nodes = int(free_index.size());
    std::vector<int> free, length;
    for (int i = 0; i < nodes; i++)
        if (free_index[i] >= 0) free.push_back(i);
    length.resize(free.size());
    struct Row { // of a thread
        std::vector<int> place, node;
    };
    std::vector<Row> rows(threads());
    for (Row& row : rows) row.place.assign(nodes, -1);
    const auto gather = [&](int i, Row& row) { // the free nodes that share a cell with i
        row.node.clear();
        for (int64_t k = bulk.start[i]; k < bulk.start[i + 1]; k++) {
            const int c = bulk.own[k].first;
            for (int64_t e = bulk.first[c]; e < bulk.first[c] + bulk.count[c]; e++)
                if (const int j = bulk.node[e]; free_index[j] >= 0 && row.place[j] < 0)
                    row.place[j] = 0, row.node.push_back(j);
        }
    };
    const auto each_free = [&](const auto& work) {
        in_chunks(int64_t(free.size()), [&](int64_t begin, int64_t end, int thread) {
            Row& row = rows[thread];
            for (int64_t n = begin; n < end; n++) {
                gather(free[n], row);
                work(n, row);
                for (int j : row.node) row.place[j] = -1;
            }
        });
    };
    each_free([&](int64_t n, Row& row) { length[n] = int(row.node.size()); });

    BlockCsr K;
    for (int n : length) K.start.push_back(K.start.back() + n);
    K.column.resize(K.start.back());
    K.block.resize(9 * K.column.size());
    each_free([&](int64_t n, Row& row) {
        const int i = free[n];
        const size_t first = size_t(K.start[n]);
        std::sort(row.node.begin(), row.node.end());
        for (size_t k = 0; k < row.node.size(); k++)
            row.place[row.node[k]] = int(k), K.column[first + k] = free_index[row.node[k]];
        const auto add = [&](const MeanGradients& all, const auto& product) {
            for (int64_t k = all.start[i]; k < all.start[i + 1]; k++) {
                const auto [c, mine] = all.own[k];
                for (int64_t e = all.first[c]; e < all.first[c] + all.count[c]; e++)
                    if (const int at = row.place[all.node[e]]; at >= 0)
                        product(&all.gradient[3 * mine], &all.gradient[3 * e], &K.block[9 * (first + at)]);
            }
        };
        add(shear, add_shear);
        add(bulk, add_bulk);
    });
    return K;
}

} // namespace

BlockCsr smoothed_stiffness(const ElasticSolid& solid, const std::vector<int>& free_index) {
    const std::vector<Shape> shape = shapes(solid);
    return assembled(mean_gradients(solid, shape, cells_of_edges(solid), solid.mu, false),
                     mean_gradients(solid, shape, cells_of_nodes(solid), solid.lam, true), free_index);
}

BlockCsr p1_stiffness(const ElasticSolid& solid, const std::vector<int>& free_index) {
    const std::vector<Shape> shape = shapes(solid);
    const Cells cells = cells_of_tetrahedra(solid);
    return assembled(mean_gradients(solid, shape, cells, solid.mu, false),
                     mean_gradients(solid, shape, cells, solid.lam, false), free_index);
}

} // namespace palpate
