#include "hyperelastic/smoothed_neo_hookean.h"
#include "base/vector_math.h"
#include "tissue/tetrahedron.h"
#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate {

constexpr int lanes = TetBlock::lanes;

// Working memory: nine numbers of one tetrahedron or cell are adjacent, since cells gather them one by one. What
// belongs to a direction v has most_directions of them, one after the other.
struct SmoothedNeoHookean::Work {
    double *gradient, *change; // (tets, 9) V/6 grad u and V/6 grad v
    double *volume, *growth;   // (tets) V J/4 and its change along v
    double* stress;            // (edge cells, 9) of the tangent: its change along v
    double *pressure, *rise;   // (node cells) dE/d(volume), and its change along v
};

namespace {

using Block = SmoothedNeoHookean::Block;

// The first pass, of a block of tetrahedra: their gradients and volumes. Returns the smallest J.
PALPATE_KERNEL double block_strain(const Block& b, const double* u, double* gradients, double* volume, double* ratio) {
    Strain s;
    Lane sixth;
    gradient(b, u, s.H);
    cofactors(s);
    for (int l = 0; l < lanes; l++) {
        ratio[l] = s.J[l], sixth[l] = b.volume[l] / 6;
        volume[l] = b.volume[l] * s.J[l] / 4;
    }
    store_nine(s.H, sixth, gradients);
    return least(s.J);
}

// The same for changes v of u, (count, nodes, 3); J and its cofactors are those of u.
PALPATE_KERNEL void block_strain_change(const Block& b, const double* u, const double* v, size_t unknowns,
                                        const Directions& directions, double* gradients, double* growth) {
    Strain s;
    Lane D[3][3], sixth;
    gradient(b, u, s.H);
    cofactors(s);
    for (int d = 0; d < directions.count; d++) {
        gradient(b, v + d * unknowns, D);
        for (int l = 0; l < lanes; l++) {
            double sum = 0;
            for (int k = 0; k < 9; k++) sum += s.C[k / 3][k % 3][l] * D[k / 3][k % 3][l];
            growth[d * directions.elements + l] = b.volume[l] * sum / 4, sixth[l] = b.volume[l] / 6;
        }
        store_nine(D, sixth, gradients + 9 * d * directions.elements);
    }
}

// V/6 times the sum of the stresses of a tetrahedron's six edge cells, and V/4 times that of a number of its node
// cells.
PALPATE_INLINE void cell_sums(const Block& b, const double* stress, const double* pressure, Lane (&P)[3][3], Lane& p) {
    for (int l = 0; l < lanes; l++) {
        double sum[9] = {};
        for (const auto& edge : b.edge) {
            const double* from = stress + 9 * size_t(edge[l]);
            for (int k = 0; k < 9; k++) sum[k] += from[k];
        }
        for (int k = 0; k < 9; k++) P[k / 3][k % 3][l] = b.volume[l] / 6 * sum[k];
        p[l] = 0;
        for (const auto& node : b.node) p[l] += b.volume[l] / 4 * pressure[node[l]];
    }
}

// The third pass: the forces of a block. Returns the energy of its barriers.
PALPATE_KERNEL double block_force(const Block& b, const double* u, const double* stress, const double* pressure,
                                  double* force) {
    constexpr double start = SmoothedNeoHookean::barrier_start;
    Strain s;
    Lane P[3][3], p, sum;
    gradient(b, u, s.H);
    cofactors(s);
    cell_sums(b, stress, pressure, P, p);
    for (int l = 0; l < lanes; l++) {
        const double below = s.J[l] < start ? fast_log(s.J[l] / start) : 0;
        sum[l] = b.mu[l] * below * below;
        p[l] += 2 * b.mu[l] * below / s.J[l];
    }
    for (int k = 0; k < 9; k++)
        for (int l = 0; l < lanes; l++) P[k / 3][k % 3][l] += p[l] * s.C[k / 3][k % 3][l];
    scatter(b, P, force);
    double total = 0;
    for (int l = 0; l < lanes; l++) total += sum[l];
    return total;
}

// Adds the change of a block's first Piola-Kirchhoff stress by volume: the pressure p turns with the cofactors, and
// changes by q.
PALPATE_INLINE void add_volume_change(const Strain& s, const Lane (&D)[3][3], const Lane& p, const Lane& q,
                                      Lane (&P)[3][3]) {
    for (int i = 0; i < 3; i++) {
        const int i1 = (i + 1) % 3, i2 = (i + 2) % 3;
        for (int j = 0; j < 3; j++) {
            const int j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            const double a = i1 == j1, d = i2 == j2, e = i1 == j2, f = i2 == j1; // of the identity in F
            for (int l = 0; l < lanes; l++)
                P[i][j][l] += q[l] * s.C[i][j][l] +
                              p[l] * (D[i1][j1][l] * (s.H[i2][j2][l] + d) + (s.H[i1][j1][l] + a) * D[i2][j2][l] -
                                      D[i1][j2][l] * (s.H[i2][j1][l] + f) - (s.H[i1][j2][l] + e) * D[i2][j1][l]);
        }
    }
}

// The changes of a block's forces along v, (count, nodes, 3).
PALPATE_KERNEL void block_force_change(const Block& b, const double* u, const double* v, size_t unknowns,
                                       const Directions& shear, const Directions& bulk, const double* stress,
                                       const double* pressure, const double* rise, double* out) {
    constexpr double start = SmoothedNeoHookean::barrier_start;
    Strain s;
    Lane P[3][3], D[3][3], p, q, bends;
    gradient(b, u, s.H);
    cofactors(s);
    for (int l = 0; l < lanes; l++) {
        const double below = s.J[l] < start ? fast_log(s.J[l] / start) : 0;
        bends[l] = s.J[l] < start ? 2 * b.mu[l] * (1 - below) / (s.J[l] * s.J[l]) : 0;
        p[l] = 2 * b.mu[l] * below / s.J[l];
        for (const auto& node : b.node) p[l] += b.volume[l] / 4 * pressure[node[l]];
    }
    for (int d = 0; d < shear.count; d++) {
        gradient(b, v + d * unknowns, D);
        cell_sums(b, stress + 9 * d * shear.cells, rise + d * bulk.cells, P, q);
        for (int l = 0; l < lanes; l++)
            for (int k = 0; k < 9; k++) q[l] += bends[l] * s.C[k / 3][k % 3][l] * D[k / 3][k % 3][l];
        add_volume_change(s, D, p, q, P);
        scatter(b, P, out + d * unknowns);
    }
}

PALPATE_KERNEL double block_ratio(const Block& b, const double* u, const double* ratio) {
    Strain s;
    gradient(b, u, s.H);
    cofactors(s);
    for (int l = 0; l < lanes; l++) s.J[l] /= ratio[l];
    return least(s.J);
}

int rounded_up(int n) { return (n + lanes - 1) / lanes * lanes; }

} // namespace

SmoothedNeoHookean::SmoothedNeoHookean(const double* nodes, int count, const int32_t* tets, int elements,
                                       const double* mu, const SmoothingCells& cells)
    : count(count), block(rounded_up(elements) / lanes), edge_lanes(rounded_up(cells.edges)),
      node_lanes(rounded_up(cells.nodes)) {
    std::vector<double> volume(elements);
    for (auto& b : block) b = Block{};
    for (int t = 0; t < elements; t++) {
        Block& b = block[t / lanes];
        const int l = t % lanes;
        double slope[3][3];
        volume[t] = shape_gradients(nodes, tets + 4 * size_t(t), slope);
        for (int c = 0; c < 4; c++) b.corner[c][l] = tets[4 * size_t(t) + c];
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++) b.slope[c][k][l] = slope[c][k];
        for (int k = 0; k < 6; k++) b.edge[k][l] = cells.edge[6 * size_t(t) + k];
        for (int k = 0; k < 4; k++) b.node[k][l] = cells.node[4 * size_t(t) + k];
        b.volume[l] = volume[t];
        b.mu[l] = mu[t] * volume[t];
    }
    edges = CellTets(cells.edge, 6, elements, cells.edges, volume.data(), cells.mu, cells.stiffening);
    nodal = CellTets(cells.node, 4, elements, cells.nodes, volume.data(), cells.lambda);
}

SmoothedNeoHookean::Work SmoothedNeoHookean::divide(double* work) const {
    const size_t n = padded();
    Work w{};
    w.gradient = work, w.change = w.gradient + 9 * n, w.volume = w.change + 9 * most_directions * n;
    w.growth = w.volume + n, w.stress = w.growth + most_directions * n;
    w.pressure = w.stress + 9 * most_directions * size_t(edge_lanes), w.rise = w.pressure + node_lanes;
    return w;
}

SmoothedNeoHookean::Energy SmoothedNeoHookean::energy(const double* u, double* force, double* ratio,
                                                      double* work) const {
    constexpr double infinite = std::numeric_limits<double>::infinity();
    const Work w = divide(work);
    Energy whole{0, infinite};
    std::fill_n(force, 3 * size_t(count), 0.0);
    for (size_t k = 0; k < block.size(); k++) {
        const size_t at = k * lanes;
        const double part = block_strain(block[k], u, w.gradient + 9 * at, w.volume + at, ratio + at);
        whole.least = std::min(whole.least, part);
        if (!(part > 0)) return {infinite, part};
    }
    for (int c = 0; c < edge_lanes; c += lanes)
        whole.value += shear_energy(edges, c, w.gradient, w.stress, whole.stiffened);
    if (!std::isfinite(whole.value)) return {infinite, whole.least};
    for (int c = 0; c < node_lanes; c += lanes)
        whole.value += bulk_energy(nodal, c, w.volume, w.pressure, nullptr, {}, nullptr);
    for (const Block& b : block) whole.value += block_force(b, u, w.stress, w.pressure, force);
    return whole;
}

double SmoothedNeoHookean::least_ratio(const double* u, const double* ratio) const {
    double value = std::numeric_limits<double>::infinity();
    for (const Block& b : block) {
        value = std::min(value, block_ratio(b, u, ratio));
        ratio += lanes;
    }
    return value;
}

void SmoothedNeoHookean::tangent(const double* u, const double* v, int directions, double* out, double* work) const {
    const Work w = divide(work);
    const size_t unknowns = 3 * size_t(count), n = padded();
    const Directions shear{directions, n, size_t(edge_lanes)}, bulk{directions, n, size_t(node_lanes)};
    std::fill_n(out, directions * unknowns, 0.0);
    for (size_t k = 0; k < block.size(); k++) {
        const size_t at = k * lanes;
        double ratio[lanes];
        block_strain(block[k], u, w.gradient + 9 * at, w.volume + at, ratio);
        block_strain_change(block[k], u, v, unknowns, shear, w.change + 9 * at, w.growth + at);
    }
    for (int c = 0; c < edge_lanes; c += lanes) shear_change(edges, c, w.gradient, w.change, shear, w.stress);
    for (int c = 0; c < node_lanes; c += lanes) bulk_energy(nodal, c, w.volume, w.pressure, w.growth, bulk, w.rise);
    for (const Block& b : block) block_force_change(b, u, v, unknowns, shear, bulk, w.stress, w.pressure, w.rise, out);
}

} // namespace palpate
