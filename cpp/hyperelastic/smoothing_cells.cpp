#include "hyperelastic/smoothing_cells.h"
#include "hyperelastic/hyperelastic_energy.h"
#include "hyperelastic/stiffening.h"
#include <algorithm>
#include <limits>

namespace palpate {
namespace {

constexpr int lanes = TetBlock::lanes;

// The means over `lanes` cells from `first` on; H of cells past the last one is zero.
PALPATE_INLINE void cell_means(const CellTets& cells, int first, const double* gradients, Lane (&H)[3][3]) {
    for (int l = 0; l < lanes; l++) {
        double sum[9] = {};
        const int c = first + l;
        const bool real = c < int(cells.volume.size());
        for (int k = real ? cells.start[c] : 0; k < (real ? cells.start[c + 1] : 0); k++) {
            const double* from = gradients + 9 * size_t(cells.tets[k]);
            for (int e = 0; e < 9; e++) sum[e] += from[e];
        }
        const double inverse = real ? 1 / cells.volume[c] : 0;
        for (int e = 0; e < 9; e++) H[e / 3][e % 3][l] = inverse * sum[e];
    }
}

PALPATE_INLINE void constants(const CellTets& cells, int first, Lane& volume, Lane& modulus) {
    for (int l = 0; l < lanes; l++) {
        const int c = first + l;
        const bool real = c < int(cells.volume.size());
        volume[l] = real ? cells.volume[c] : 0, modulus[l] = real ? cells.modulus[c] : 0;
    }
}

PALPATE_INLINE void stiffening_of(const CellTets& cells, int first, Lane& b) {
    for (int l = 0; l < lanes; l++)
        b[l] = first + l < int(cells.stiffening.size()) ? cells.stiffening[first + l] : least_stiffening;
}

} // namespace

CellTets::CellTets(const int32_t* cell, int per_tet, int elements, int count, const double* whole,
                   const double* modulus, const double* b)
    : start(count + 1, 0), tets(size_t(per_tet) * elements), volume(count, 0), modulus(modulus, modulus + count) {
    for (int k = 0; k < per_tet * elements; k++) {
        start[cell[k] + 1]++;
        volume[cell[k]] += whole[k / per_tet] / per_tet;
    }
    for (int c = 0; c < count; c++) start[c + 1] += start[c];
    std::vector<int> next(start.begin(), start.end() - 1);
    for (int k = 0; k < per_tet * elements; k++) tets[next[cell[k]]++] = k / per_tet;
    if (b && std::any_of(b, b + count, [](double x) { return x > 0; }))
        for (int c = 0; c < count; c++) stiffening.push_back(std::max(b[c], least_stiffening));
}

// Numerical kernels.

PALPATE_KERNEL double shear_energy(const CellTets& cells, int first, const double* gradients, double* stress,
                                   double& stiffened) {
    constexpr double infinite = std::numeric_limits<double>::infinity();
    Strain s;
    Lane P[3][3], volume, mu, shear, b, one, sum;
    cell_means(cells, first, gradients, s.H);
    constants(cells, first, volume, mu);
    cofactors(s);
    if (!(least(s.J) > 0)) return infinite;
    for (int l = 0; l < lanes; l++) {
        double square = 0, trace = s.H[0][0][l] + s.H[1][1][l] + s.H[2][2][l];
        for (int k = 0; k < 9; k++) square += s.H[k / 3][k % 3][l] * s.H[k / 3][k % 3][l];
        shear[l] = trace + 0.5 * square - fast_log(s.J[l]);
        sum[l] = volume[l] * mu[l] * shear[l], one[l] = 1;
    }
    if (!cells.stiffening.empty()) {
        stiffening_of(cells, first, b);
        stiffened = std::max(stiffened, stiffen(b, shear, mu));
        if (!(stiffened < most_stiffened)) return infinite;
        for (int l = 0; l < lanes; l++) sum[l] += volume[l] * shear[l];
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int l = 0; l < lanes; l++) P[i][j][l] = mu[l] * (s.H[i][j][l] + (i == j) - s.C[i][j][l] / s.J[l]);
    store_nine(P, one, stress + 9 * size_t(first));
    double total = 0;
    for (int l = 0; l < lanes; l++) total += sum[l];
    return total;
}

PALPATE_KERNEL void shear_change(const CellTets& cells, int first, const double* gradients, const double* changes,
                                 const Directions& directions, double* stress) {
    Strain s;
    Lane D[3][3], T[3][3], P[3][3], Q[3][3], volume, mu, shear, b, one;
    const bool stiffens = !cells.stiffening.empty();
    cell_means(cells, first, gradients, s.H);
    constants(cells, first, volume, mu);
    cofactors(s);
    for (int k = 0; k < 9; k++)
        for (int l = 0; l < lanes; l++) s.C[k / 3][k % 3][l] /= s.J[l], one[l] = 1; // C is G now
    if (stiffens) {
        stiffening_of(cells, first, b);
        shear_strain(s, s.C, shear, Q);
        stiffen(b, shear, mu);
    }
    for (int d = 0; d < directions.count; d++) {
        cell_means(cells, first, changes + 9 * d * directions.elements, D);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                for (int l = 0; l < lanes; l++)
                    T[i][j][l] = s.C[i][0][l] * D[j][0][l] + s.C[i][1][l] * D[j][1][l] + s.C[i][2][l] * D[j][2][l];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                for (int l = 0; l < lanes; l++)
                    P[i][j][l] = mu[l] * (D[i][j][l] + T[i][0][l] * s.C[0][j][l] + T[i][1][l] * s.C[1][j][l] +
                                          T[i][2][l] * s.C[2][j][l]);
        if (stiffens) add_stiffening(b, mu, Q, D, P);
        store_nine(P, one, stress + 9 * (d * directions.cells + size_t(first)));
    }
}

PALPATE_KERNEL double bulk_energy(const CellTets& cells, int first, const double* volumes, double* pressure,
                                  const double* growths, const Directions& directions, double* rise) {
    Lane volume, lambda, J, sum, change[HyperelasticEnergy::most_directions];
    constants(cells, first, volume, lambda);
    for (int l = 0; l < lanes; l++) {
        const int c = first + l;
        const bool real = c < int(cells.volume.size());
        double now = 0, more[HyperelasticEnergy::most_directions] = {};
        for (int k = real ? cells.start[c] : 0; k < (real ? cells.start[c + 1] : 0); k++) {
            now += volumes[cells.tets[k]];
            for (int d = 0; d < directions.count; d++) more[d] += growths[d * directions.elements + cells.tets[k]];
        }
        J[l] = real ? now / cells.volume[c] : 1;
        for (int d = 0; d < directions.count; d++) change[d][l] = real ? more[d] / cells.volume[c] : 0;
    }
    for (int l = 0; l < lanes; l++) {
        const double logarithm = fast_log(J[l]);
        sum[l] = 0.5 * volume[l] * lambda[l] * logarithm * logarithm;
        pressure[first + l] = lambda[l] * logarithm / J[l];
        for (int d = 0; d < directions.count; d++)
            rise[d * directions.cells + first + l] = lambda[l] * (1 - logarithm) / (J[l] * J[l]) * change[d][l];
    }
    double total = 0;
    for (int l = 0; l < lanes; l++) total += sum[l];
    return total;
}

} // namespace palpate
