#include "hyperelastic/neo_hookean.h"
#include "base/cpu_dispatch.h"
#include "base/vector_math.h"
#include "tissue/tetrahedron.h"
#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

constexpr int lanes = NeoHookean::lanes;
using Block = NeoHookean::Block;
typedef double Lane[lanes];

// Of a block: H = grad u, C the cofactors of F = 1 + H, and J.
struct Strain {
    Lane H[3][3], C[3][3], J;
};

// H[i][j] = du_i/dX_j. The gather is scalar, the products are vector code.
PALPATE_INLINE void gradient(const Block& b, const double* u, Lane (&H)[3][3]) {
    Lane e[3][3];
    for (int l = 0; l < lanes; l++) {
        const double* first = u + 3 * size_t(b.corner[0][l]);
        for (int c = 0; c < 3; c++) {
            const double* x = u + 3 * size_t(b.corner[c + 1][l]);
            for (int i = 0; i < 3; i++) e[c][i][l] = x[i] - first[i];
        }
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int l = 0; l < lanes; l++)
                H[i][j][l] =
                    e[0][i][l] * b.slope[0][j][l] + e[1][i][l] * b.slope[1][j][l] + e[2][i][l] * b.slope[2][j][l];
}

PALPATE_INLINE void cofactors(Strain& s) {
    for (int i = 0; i < 3; i++) {
        const int i1 = (i + 1) % 3, i2 = (i + 2) % 3;
        for (int j = 0; j < 3; j++) {
            const int j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            const double a = i1 == j1, b = i2 == j2, c = i1 == j2, d = i2 == j1; // of the identity in F
            for (int l = 0; l < lanes; l++)
                s.C[i][j][l] =
                    (s.H[i1][j1][l] + a) * (s.H[i2][j2][l] + b) - (s.H[i1][j2][l] + c) * (s.H[i2][j1][l] + d);
        }
    }
    for (int l = 0; l < lanes; l++)
        s.J[l] = (1 + s.H[0][0][l]) * s.C[0][0][l] + s.H[0][1][l] * s.C[0][1][l] + s.H[0][2][l] * s.C[0][2][l];
}

// P times the volume: mu (F - F^-T) + lambda ln J F^-T. Returns the block's energy.
PALPATE_INLINE double stress(const Block& b, const Strain& s, Lane (&P)[3][3]) {
    Lane logarithm, along, sum;
    for (int l = 0; l < lanes; l++) logarithm[l] = fast_log(s.J[l]);
    for (int l = 0; l < lanes; l++) {
        double square = 0, trace = s.H[0][0][l] + s.H[1][1][l] + s.H[2][2][l];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) square += s.H[i][j][l] * s.H[i][j][l];
        sum[l] = b.mu[l] * (trace + 0.5 * square - logarithm[l]) + 0.5 * b.lambda[l] * logarithm[l] * logarithm[l];
        along[l] = (b.lambda[l] * logarithm[l] - b.mu[l]) / s.J[l];
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int l = 0; l < lanes; l++) P[i][j][l] = b.mu[l] * (s.H[i][j][l] + (i == j)) + along[l] * s.C[i][j][l];
    double total = 0;
    for (int l = 0; l < lanes; l++) total += sum[l];
    return total;
}

// The change of P for a change D of F: mu D + (mu - lambda ln J) G D' G + lambda (G : D) G, G = F^-T = C / J.
PALPATE_INLINE void stress_change(const Block& b, const Strain& s, const Lane (&D)[3][3], Lane (&P)[3][3]) {
    Lane G[3][3], T[3][3], logarithm, both;
    for (int l = 0; l < lanes; l++) logarithm[l] = fast_log(s.J[l]);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int l = 0; l < lanes; l++) G[i][j][l] = s.C[i][j][l] / s.J[l];
    for (int l = 0; l < lanes; l++) {
        double sum = 0;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) sum += G[i][j][l] * D[i][j][l];
        both[l] = b.lambda[l] * sum;
    }
    for (int i = 0; i < 3; i++) // T = G D'
        for (int j = 0; j < 3; j++)
            for (int l = 0; l < lanes; l++)
                T[i][j][l] = G[i][0][l] * D[j][0][l] + G[i][1][l] * D[j][1][l] + G[i][2][l] * D[j][2][l];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int l = 0; l < lanes; l++)
                P[i][j][l] = b.mu[l] * D[i][j][l] + both[l] * G[i][j][l] +
                             (b.mu[l] - b.lambda[l] * logarithm[l]) *
                                 (T[i][0][l] * G[0][j][l] + T[i][1][l] * G[1][j][l] + T[i][2][l] * G[2][j][l]);
}

// force += P grad(shape) of each corner.
PALPATE_INLINE void scatter(const Block& b, const Lane (&P)[3][3], double* force) {
    Lane f[3][3];
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < 3; i++)
            for (int l = 0; l < lanes; l++)
                f[c][i][l] =
                    P[i][0][l] * b.slope[c][0][l] + P[i][1][l] * b.slope[c][1][l] + P[i][2][l] * b.slope[c][2][l];
    for (int l = 0; l < lanes; l++) {
        double* first = force + 3 * size_t(b.corner[0][l]);
        for (int c = 0; c < 3; c++) {
            double* x = force + 3 * size_t(b.corner[c + 1][l]);
            for (int i = 0; i < 3; i++) x[i] += f[c][i][l], first[i] -= f[c][i][l];
        }
    }
}

PALPATE_INLINE double least(const Lane& J) {
    double value = J[0];
    for (int l = 1; l < lanes; l++) value = J[l] < value ? J[l] : value;
    return value;
}

// Numerical kernels, one block each: free functions, so that the compiler vectorises them for each instruction set.
PALPATE_KERNEL NeoHookean::Energy block_energy(const Block& b, const double* u, double* force, double* ratio) {
    Strain s;
    Lane P[3][3];
    gradient(b, u, s.H);
    cofactors(s);
    for (int l = 0; l < lanes; l++) ratio[l] = s.J[l];
    const double flattest = least(s.J);
    if (!(flattest > 0)) return {std::numeric_limits<double>::infinity(), flattest};
    const double value = stress(b, s, P);
    scatter(b, P, force);
    return {value, flattest};
}

PALPATE_KERNEL double block_ratio(const Block& b, const double* u, const double* ratio) {
    Strain s;
    gradient(b, u, s.H);
    cofactors(s);
    for (int l = 0; l < lanes; l++) s.J[l] /= ratio[l];
    return least(s.J);
}

PALPATE_KERNEL void block_tangent(const Block& b, const double* u, const double* v, double* out) {
    Strain s;
    Lane D[3][3], P[3][3];
    gradient(b, u, s.H);
    cofactors(s);
    gradient(b, v, D);
    stress_change(b, s, D, P);
    scatter(b, P, out);
}

} // namespace

NeoHookean::NeoHookean(const double* nodes, int count, const int32_t* tets, int elements, const double* lambda,
                       const double* mu)
    : count(count), size(elements), block((elements + lanes - 1) / lanes) {
    for (auto& b : block) b = Block{};
    for (int t = 0; t < elements; t++) {
        Block& b = block[t / lanes];
        const int l = t % lanes;
        double slope[3][3];
        const double volume = shape_gradients(nodes, tets + 4 * size_t(t), slope);
        for (int c = 0; c < 4; c++) b.corner[c][l] = tets[4 * size_t(t) + c];
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++) b.slope[c][k][l] = slope[c][k];
        b.mu[l] = mu[t] * volume;
        b.lambda[l] = lambda[t] * volume;
    }
}

NeoHookean::Energy NeoHookean::energy(const double* u, double* force, double* ratio) const {
    Energy whole{0, std::numeric_limits<double>::infinity()};
    std::fill_n(force, 3 * size_t(count), 0.0);
    for (const Block& b : block) {
        const Energy part = block_energy(b, u, force, ratio);
        ratio += lanes;
        whole.value += part.value;
        whole.least = std::min(whole.least, part.least);
        if (!(part.least > 0)) return {part.value, part.least};
    }
    return whole;
}

double NeoHookean::least_ratio(const double* u, const double* ratio) const {
    double value = std::numeric_limits<double>::infinity();
    for (const Block& b : block) {
        value = std::min(value, block_ratio(b, u, ratio));
        ratio += lanes;
    }
    return value;
}

void NeoHookean::tangent(const double* u, const double* v, double* out) const {
    std::fill_n(out, 3 * size_t(count), 0.0);
    for (const Block& b : block) block_tangent(b, u, v, out);
}

} // namespace palpate
