#include "hyperelastic/neo_hookean.h"
#include "hyperelastic/stiffening.h"
#include "tissue/tetrahedron.h"
#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

constexpr int lanes = TetBlock::lanes;
using Block = NeoHookean::Block;
using Exponents = NeoHookean::Exponents;

constexpr double infinite = std::numeric_limits<double>::infinity();

// P times the volume: mu (F - F^-T) + lambda ln J F^-T, mu grown by stiffening. stiffening: null if there is none.
PALPATE_INLINE NeoHookean::Energy stress(const Block& b, const Exponents* stiffening, const Strain& s,
                                         Lane (&P)[3][3]) {
    Lane logarithm, shear, mu, along, sum;
    double stiffened = 0;
    for (int l = 0; l < lanes; l++) logarithm[l] = fast_log(s.J[l]);
    for (int l = 0; l < lanes; l++) {
        double square = 0, trace = s.H[0][0][l] + s.H[1][1][l] + s.H[2][2][l];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) square += s.H[i][j][l] * s.H[i][j][l];
        shear[l] = trace + 0.5 * square - logarithm[l], mu[l] = b.mu[l];
        sum[l] = b.mu[l] * shear[l] + 0.5 * b.lambda[l] * logarithm[l] * logarithm[l];
    }
    if (stiffening) {
        stiffened = stiffen(stiffening->b, shear, mu);
        for (int l = 0; l < lanes; l++) sum[l] += shear[l];
    }
    for (int l = 0; l < lanes; l++) along[l] = (b.lambda[l] * logarithm[l] - mu[l]) / s.J[l];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int l = 0; l < lanes; l++) P[i][j][l] = mu[l] * (s.H[i][j][l] + (i == j)) + along[l] * s.C[i][j][l];
    double total = 0;
    for (int l = 0; l < lanes; l++) total += sum[l];
    return {stiffened < most_stiffened ? total : infinite, least(s.J), stiffened};
}

// G = F^-T = C / J
PALPATE_INLINE void inverse_transpose(const Strain& s, Lane (&G)[3][3]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int l = 0; l < lanes; l++) G[i][j][l] = s.C[i][j][l] / s.J[l];
}

// The change of P for a change D of F: mu D + (mu - lambda ln J) G D' G + lambda (G : D) G, mu that of P.
PALPATE_INLINE void stress_change(const Block& b, const Lane& mu, const Strain& s, const Lane (&D)[3][3],
                                  Lane (&P)[3][3]) {
    Lane G[3][3], T[3][3], logarithm, both;
    for (int l = 0; l < lanes; l++) logarithm[l] = fast_log(s.J[l]);
    inverse_transpose(s, G);
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
                P[i][j][l] = mu[l] * D[i][j][l] + both[l] * G[i][j][l] +
                             (mu[l] - b.lambda[l] * logarithm[l]) *
                                 (T[i][0][l] * G[0][j][l] + T[i][1][l] * G[1][j][l] + T[i][2][l] * G[2][j][l]);
}

// Numerical kernels, one block each: free functions, so that the compiler vectorises them for each instruction set.
PALPATE_KERNEL NeoHookean::Energy block_energy(const Block& b, const Exponents* stiffening, const double* u,
                                               double* force, double* ratio) {
    Strain s;
    Lane P[3][3];
    gradient(b, u, s.H);
    cofactors(s);
    for (int l = 0; l < lanes; l++) ratio[l] = s.J[l];
    const double flattest = least(s.J);
    if (!(flattest > 0)) return {infinite, flattest};
    const NeoHookean::Energy value = stress(b, stiffening, s, P);
    scatter(b, P, force);
    return value;
}

PALPATE_KERNEL double block_ratio(const Block& b, const double* u, const double* ratio) {
    Strain s;
    gradient(b, u, s.H);
    cofactors(s);
    for (int l = 0; l < lanes; l++) s.J[l] /= ratio[l];
    return least(s.J);
}

PALPATE_KERNEL void block_tangent(const Block& b, const double* u, const double* v, int count, size_t n, double* out) {
    Strain s;
    Lane D[3][3], P[3][3];
    gradient(b, u, s.H);
    cofactors(s);
    for (int d = 0; d < count; d++) {
        gradient(b, v + d * n, D);
        stress_change(b, b.mu, s, D, P);
        scatter(b, P, out + d * n);
    }
}

// The same where elements stiffen; apart, since the larger frame would slow the other down.
PALPATE_KERNEL void stiffening_tangent(const Block& b, const Exponents& stiffening, const double* u, const double* v,
                                       int count, size_t n, double* out) {
    Strain s;
    Lane D[3][3], P[3][3], G[3][3], Q[3][3], shear, mu;
    gradient(b, u, s.H);
    cofactors(s);
    inverse_transpose(s, G);
    shear_strain(s, G, shear, Q);
    for (int l = 0; l < lanes; l++) mu[l] = b.mu[l];
    stiffen(stiffening.b, shear, mu);
    for (int d = 0; d < count; d++) {
        gradient(b, v + d * n, D);
        stress_change(b, mu, s, D, P);
        add_stiffening(stiffening.b, mu, Q, D, P);
        scatter(b, P, out + d * n);
    }
}

} // namespace

NeoHookean::NeoHookean(const double* nodes, int count, const int32_t* tets, int elements, const double* lambda,
                       const double* mu, const double* exponent)
    : count(count), block((elements + lanes - 1) / lanes) {
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
    if (!exponent || std::all_of(exponent, exponent + elements, [](double b) { return b == 0; })) return;
    stiffening.resize(block.size());
    for (int t = 0; t < padded(); t++)
        stiffening[t / lanes].b[t % lanes] = std::max(t < elements ? exponent[t] : 0, least_stiffening);
}

NeoHookean::Energy NeoHookean::energy(const double* u, double* force, double* ratio, double*) const {
    Energy whole{0, infinite};
    std::fill_n(force, 3 * size_t(count), 0.0);
    for (size_t k = 0; k < block.size(); k++) {
        const Energy part = block_energy(block[k], stiffening.empty() ? nullptr : &stiffening[k], u, force, ratio);
        ratio += lanes;
        whole.value += part.value;
        whole.least = std::min(whole.least, part.least);
        whole.stiffened = std::max(whole.stiffened, part.stiffened);
        if (!std::isfinite(part.value)) return {infinite, part.least};
    }
    return whole;
}

double NeoHookean::least_ratio(const double* u, const double* ratio) const {
    double value = infinite;
    for (const Block& b : block) {
        value = std::min(value, block_ratio(b, u, ratio));
        ratio += lanes;
    }
    return value;
}

void NeoHookean::tangent(const double* u, const double* v, int directions, double* out, double*) const {
    const size_t n = 3 * size_t(count);
    std::fill_n(out, directions * n, 0.0);
    for (size_t k = 0; k < block.size(); k++)
        if (stiffening.empty())
            block_tangent(block[k], u, v, directions, n, out);
        else
            stiffening_tangent(block[k], stiffening[k], u, v, directions, n, out);
}

} // namespace palpate
