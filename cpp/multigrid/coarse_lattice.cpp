#include "multigrid/coarse_lattice.h"
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace palpate {
namespace {

constexpr double min_fill = 0.15; // of the fullest cell

void trilinear_weights(const double f[3], double w[8]) {
    for (int c = 0; c < 8; c++)
        w[c] = (c & 4 ? f[0] : 1 - f[0]) * (c & 2 ? f[1] : 1 - f[1]) * (c & 1 ? f[2] : 1 - f[2]);
}

// A grid of cubic cells; the active ones carry unknowns.
struct CellGrid {
    double low[3], edge;
    int count[3];
    std::vector<uint8_t> active;

    int index(const int c[3]) const { return (c[0] * count[1] + c[1]) * count[2] + c[2]; }
    void cell_of(const double x[3], int c[3]) const {
        for (int k = 0; k < 3; k++) c[k] = std::clamp(int(std::floor((x[k] - low[k]) / edge)), 0, count[k] - 1);
    }
    double distance2(const double x[3], const int c[3]) const { // squared, to the cell; among equals, to its centre
        double sum = 0;
        for (int k = 0; k < 3; k++) {
            double f = std::abs((x[k] - low[k]) / edge - c[k] - 0.5), out = std::max(f - 0.5, 0.0);
            sum += out * out + 1e-9 * f * f;
        }
        return sum;
    }
    // The active cell nearest to x.
    void nearest_active(const double x[3], int best[3]) const {
        int own[3];
        cell_of(x, own);
        std::copy_n(own, 3, best);
        if (active[index(own)]) return;
        const int most = std::max({count[0], count[1], count[2]});
        double nearest = 1e300;
        for (int r = 1; r <= most && nearest == 1e300; r++)
            for (int a = std::max(own[0] - r, 0); a <= std::min(own[0] + r, count[0] - 1); a++)
                for (int b = std::max(own[1] - r, 0); b <= std::min(own[1] + r, count[1] - 1); b++)
                    for (int c = std::max(own[2] - r, 0); c <= std::min(own[2] + r, count[2] - 1); c++) {
                        const int cell[3] = {a, b, c};
                        if (!active[index(cell)]) continue;
                        if (double d = distance2(x, cell); d < nearest) nearest = d, std::copy_n(cell, 3, best);
                    }
    }
    void weights(const double x[3], const int c[3], double w[8]) const {
        double f[3];
        for (int k = 0; k < 3; k++) f[k] = (x[k] - low[k]) / edge - c[k];
        trilinear_weights(f, w);
    }
};

void centre(const ElasticMesh& mesh, int t, double x[3]) {
    for (int k = 0; k < 3; k++) {
        x[k] = 0;
        for (int a = 0; a < 4; a++) x[k] += mesh.node[3 * size_t(mesh.tet[4 * size_t(t) + a]) + k] / 4;
    }
}

CellGrid make_cells(const ElasticMesh& mesh, double edge) {
    CellGrid box;
    double high[3];
    for (int k = 0; k < 3; k++) {
        box.low[k] = high[k] = mesh.node[k];
        for (int i = 0; i < mesh.nodes; i++) {
            box.low[k] = std::min(box.low[k], mesh.node[3 * size_t(i) + k]);
            high[k] = std::max(high[k], mesh.node[3 * size_t(i) + k]);
        }
    }
    box.edge = edge;
    double size[3], all = 1;
    for (int k = 0; k < 3; k++) size[k] = high[k] - box.low[k], all *= size[k] / edge + 1;
    if (all > 4e6) box.edge *= std::cbrt(all / 4e6); // limits the memory for a sparse mesh
    for (int k = 0; k < 3; k++) {
        box.count[k] = std::max(1, int(std::ceil(size[k] / box.edge - 1e-9)));
        box.low[k] -= (box.count[k] * box.edge - size[k]) / 2;
    }
    std::vector<double> fill(size_t(box.count[0]) * box.count[1] * box.count[2]);
    for (int t = 0; t < mesh.tets; t++) {
        double x[3], g[4][3];
        int c[3];
        centre(mesh, t, x);
        box.cell_of(x, c);
        fill[box.index(c)] += shape_gradients(mesh, t, g);
    }
    const double most = *std::max_element(fill.begin(), fill.end());
    for (double f : fill) box.active.push_back(f > min_fill * most);
    return box;
}

} // namespace

void CoarseLattice::number_nodes(const std::vector<uint8_t>& used) {
    number.assign(used.size(), -1);
    for (int at = 0; at < int(used.size()); at++) {
        if (!used[at]) continue;
        number[at] = nodes();
        index3.insert(index3.end(), {at / extent[2] / extent[1], at / extent[2] % extent[1], at % extent[2]});
    }
    coupling.assign(size_t(nodes()) * neighbourhood * 9, 0);
}

double* CoarseLattice::block(int a, int b) {
    int slot = 0;
    for (int k = 0; k < 3; k++) slot = 3 * slot + index3[3 * size_t(b) + k] - index3[3 * size_t(a) + k] + 1;
    return &coupling[9 * (size_t(a) * neighbourhood + slot)];
}

CoarseLattice::CoarseLattice(const ElasticMesh& mesh, double edge, Interpolation& up) {
    const CellGrid box = make_cells(mesh, edge);
    for (int k = 0; k < 3; k++) extent[k] = box.count[k] + 1;
    auto corners = [&](const int c[3], int out[8]) {
        for (int k = 0; k < 8; k++) out[k] = index(c[0] + (k >> 2), c[1] + (k >> 1 & 1), c[2] + (k & 1));
    };
    std::vector<uint8_t> used(size_t(extent[0]) * extent[1] * extent[2]);
    int c[3], corner[8];
    for (c[0] = 0; c[0] < box.count[0]; c[0]++)
        for (c[1] = 0; c[1] < box.count[1]; c[1]++)
            for (c[2] = 0; c[2] < box.count[2]; c[2]++) {
                if (!box.active[box.index(c)]) continue;
                corners(c, corner);
                for (int at : corner) used[at] = 1;
            }
    number_nodes(used);
    double w[8];
    for (int i = 0; i < mesh.nodes; i++) {
        const double* x = mesh.node + 3 * size_t(i);
        box.nearest_active(x, c);
        box.weights(x, c, w);
        corners(c, corner);
        for (int k = 0; k < 8; k++) {
            up.parent.push_back(4 * number[corner[k]]);
            up.weight.push_back(mesh.fixed[i] ? 0 : float(w[k]));
        }
    }
    for (int t = 0; t < mesh.tets; t++) {
        double x[3], g[4][3], G[8][3] = {};
        const double volume = shape_gradients(mesh, t, g);
        centre(mesh, t, x);
        box.nearest_active(x, c);
        corners(c, corner);
        for (int a = 0; a < 4; a++) {
            const int i = mesh.tet[4 * size_t(t) + a];
            if (mesh.fixed[i]) continue;
            box.weights(mesh.node + 3 * size_t(i), c, w);
            for (int k = 0; k < 8; k++)
                for (int b = 0; b < 3; b++) G[k][b] += w[k] * g[a][b];
        }
        for (int a = 0; a < 8; a++)
            for (int b = 0; b < 8; b++)
                add_stiffness(volume * mesh.lam[t], volume * mesh.mu[t], G[a], G[b],
                              block(number[corner[a]], number[corner[b]]));
    }
}

CoarseLattice CoarseLattice::coarsen(Interpolation& up) const {
    CoarseLattice coarse;
    for (int k = 0; k < 3; k++) coarse.extent[k] = extent[k] / 2 + 1;
    std::vector<int> parent(8 * size_t(nodes()));
    std::vector<uint8_t> used(size_t(coarse.extent[0]) * coarse.extent[1] * coarse.extent[2]);
    std::vector<double> weight(8 * size_t(nodes()));
    for (int i = 0; i < nodes(); i++) {
        const int* g = &index3[3 * size_t(i)];
        const double f[3] = {0.5 * (g[0] % 2), 0.5 * (g[1] % 2), 0.5 * (g[2] % 2)};
        double* w = &weight[8 * size_t(i)];
        trilinear_weights(f, w);
        for (int k = 0; k < 8; k++) { // a parent of weight 0 may lie outside: takes the first
            int at = coarse.index(g[0] / 2 + (w[k] > 0 && k & 4 ? 1 : 0), g[1] / 2 + (w[k] > 0 && k & 2 ? 1 : 0),
                                  g[2] / 2 + (w[k] > 0 && k & 1 ? 1 : 0));
            parent[8 * size_t(i) + k] = at;
            if (w[k] > 0) used[at] = 1;
        }
    }
    coarse.number_nodes(used);
    for (size_t k = 0; k < parent.size(); k++) {
        parent[k] = coarse.number[parent[k]];
        up.parent.push_back(4 * parent[k]);
        up.weight.push_back(float(weight[k]));
    }
    const BlockCsr fine = stiffness();
    for (int i = 0; i < nodes(); i++)
        for (int k = fine.start[i]; k < fine.start[i + 1]; k++)
            for (int a = 0; a < 8; a++)
                for (int b = 0; b < 8; b++) {
                    const size_t p = 8 * size_t(i) + a, q = 8 * size_t(fine.column[k]) + b;
                    const double w = weight[p] * weight[q];
                    if (w == 0) continue;
                    double* out = coarse.block(parent[p], parent[q]);
                    for (int e = 0; e < 9; e++) out[e] += w * fine.block[9 * size_t(k) + e];
                }
    return coarse;
}

BlockCsr CoarseLattice::stiffness() const {
    BlockCsr K;
    for (int i = 0; i < nodes(); i++) {
        const int* g = &index3[3 * size_t(i)];
        std::vector<std::pair<int, int>> row; // neighbour, slot
        for (int slot = 0; slot < neighbourhood; slot++) {
            const double* from = &coupling[9 * (size_t(i) * neighbourhood + slot)];
            if (slot != neighbourhood / 2 && std::all_of(from, from + 9, [](double v) { return v == 0; })) continue;
            row.push_back({number[index(g[0] + slot / 9 - 1, g[1] + slot / 3 % 3 - 1, g[2] + slot % 3 - 1)], slot});
        }
        std::sort(row.begin(), row.end());
        for (auto [neighbour, slot] : row) {
            const double* from = &coupling[9 * (size_t(i) * neighbourhood + slot)];
            const bool own = slot == neighbourhood / 2;
            K.column.push_back(neighbour);
            K.block.insert(K.block.end(), from, from + 9);
            if (own) { // keeps the block invertible if the node has a free direction
                double* d = &K.block[K.block.size() - 9];
                const double more = 1e-6 * (d[0] + d[4] + d[8]) + 1e-30;
                for (int k = 0; k < 3; k++) d[4 * k] += more;
            }
        }
        K.start.push_back(int(K.column.size()));
    }
    return K;
}

} // namespace palpate
