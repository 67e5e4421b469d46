// Stiffening of the shear energy with stretch. Included by neo_hookean.cpp and smoothing_cells.cpp, in kernels that are
// compiled for each instruction set. Source: H. Demiray, J. Biomech. 5 (1972) 309.
#pragma once
#include "base/vector_math.h"
#include "hyperelastic/tet_block.h"

namespace palpate {

// The neo-Hookean shear energy mu s, s = (tr F'F - 3)/2 - ln J >= 0, becomes
//
//     mu/2b (e^(2 b s) - 1),
//
// Demiray's law at J = 1, that of D. R. Veronda & R. A. Westmann (J. Biomech. 3 (1970) 111) without their second term.
// s is of second order in the strain, so neither the stiffness at rest nor Poisson's ratio depends on b. s is
// polyconvex and the exponential convex and rising: so is the energy.
constexpr double least_stiffening = 1e-30; // of elements that do not stiffen, beside others: e^x - 1 is x there
constexpr double most_stiffened = 200;     // 2 b s; beyond it squares of forces could overflow

// s becomes what the energy gains over mu s, and mu that of the stress mu (F - F^-T), mu e^(2 b s). Returns the largest
// 2 b s.
PALPATE_INLINE double stiffen(const Lane& b, Lane& s, Lane& mu) {
    Lane negative;
    for (int l = 0; l < TetBlock::lanes; l++) {
        const double exponent = 2 * b[l] * s[l], grown = fast_expm1(exponent);
        negative[l] = -exponent;
        s[l] = mu[l] * (grown / (2 * b[l]) - s[l]);
        mu[l] += mu[l] * grown;
    }
    return -least(negative);
}

// s, and its derivative Q = F - F^-T. G is F^-T.
PALPATE_INLINE void shear_strain(const Strain& at, const Lane (&G)[3][3], Lane& s, Lane (&Q)[3][3]) {
    for (int l = 0; l < TetBlock::lanes; l++) {
        double square = 0, trace = at.H[0][0][l] + at.H[1][1][l] + at.H[2][2][l];
        for (int k = 0; k < 9; k++) square += at.H[k / 3][k % 3][l] * at.H[k / 3][k % 3][l];
        s[l] = trace + 0.5 * square - fast_log(at.J[l]);
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int l = 0; l < TetBlock::lanes; l++) Q[i][j][l] = at.H[i][j][l] + (i == j) - G[i][j][l];
}

// Adds what stiffening adds to the change of the stress for a change D of F: 2 b mu (Q : D) Q, mu that of the stress.
PALPATE_INLINE void add_stiffening(const Lane& b, const Lane& mu, const Lane (&Q)[3][3], const Lane (&D)[3][3],
                                   Lane (&P)[3][3]) {
    Lane along;
    for (int l = 0; l < TetBlock::lanes; l++) {
        double sum = 0;
        for (int k = 0; k < 9; k++) sum += Q[k / 3][k % 3][l] * D[k / 3][k % 3][l];
        along[l] = 2 * b[l] * mu[l] * sum;
    }
    for (int k = 0; k < 9; k++)
        for (int l = 0; l < TetBlock::lanes; l++) P[k / 3][k % 3][l] += along[l] * Q[k / 3][k % 3][l];
}

} // namespace palpate
