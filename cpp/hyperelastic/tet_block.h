// Strain and forces of a block of linear tetrahedra: the loops that energies of such elements share. Included by
// neo_hookean.cpp and smoothed_neo_hookean.cpp, whose kernels are compiled for each instruction set.
#pragma once
#include "base/cpu_dispatch.h"
#include <cstddef>
#include <cstdint>

namespace palpate {

// The shapes of `lanes` elements; the last block of a mesh is padded with elements of zero volume.
struct TetBlock {
    static constexpr int lanes = 32;
    int32_t corner[4][lanes];
    double slope[3][3][lanes]; // [corner - 1][axis] 1/mm, gradient of the corner's shape function; they sum to zero
};

typedef double Lane[TetBlock::lanes];

// Of a block: H = grad u, C the cofactors of F = 1 + H, and J.
struct Strain {
    Lane H[3][3], C[3][3], J;
};

// H[i][j] = du_i/dX_j. The gather is scalar, the products are vector code.
PALPATE_INLINE void gradient(const TetBlock& b, const double* u, Lane (&H)[3][3]) {
    Lane e[3][3];
    for (int l = 0; l < TetBlock::lanes; l++) {
        const double* first = u + 3 * size_t(b.corner[0][l]);
        for (int c = 0; c < 3; c++) {
            const double* x = u + 3 * size_t(b.corner[c + 1][l]);
            for (int i = 0; i < 3; i++) e[c][i][l] = x[i] - first[i];
        }
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int l = 0; l < TetBlock::lanes; l++)
                H[i][j][l] =
                    e[0][i][l] * b.slope[0][j][l] + e[1][i][l] * b.slope[1][j][l] + e[2][i][l] * b.slope[2][j][l];
}

PALPATE_INLINE void cofactors(Strain& s) {
    for (int i = 0; i < 3; i++) {
        const int i1 = (i + 1) % 3, i2 = (i + 2) % 3;
        for (int j = 0; j < 3; j++) {
            const int j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            const double a = i1 == j1, b = i2 == j2, c = i1 == j2, d = i2 == j1; // of the identity in F
            for (int l = 0; l < TetBlock::lanes; l++)
                s.C[i][j][l] =
                    (s.H[i1][j1][l] + a) * (s.H[i2][j2][l] + b) - (s.H[i1][j2][l] + c) * (s.H[i2][j1][l] + d);
        }
    }
    for (int l = 0; l < TetBlock::lanes; l++)
        s.J[l] = (1 + s.H[0][0][l]) * s.C[0][0][l] + s.H[0][1][l] * s.C[0][1][l] + s.H[0][2][l] * s.C[0][2][l];
}

// force += P grad(shape) of each corner.
PALPATE_INLINE void scatter(const TetBlock& b, const Lane (&P)[3][3], double* force) {
    Lane f[3][3];
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < 3; i++)
            for (int l = 0; l < TetBlock::lanes; l++)
                f[c][i][l] =
                    P[i][0][l] * b.slope[c][0][l] + P[i][1][l] * b.slope[c][1][l] + P[i][2][l] * b.slope[c][2][l];
    for (int l = 0; l < TetBlock::lanes; l++) {
        double* first = force + 3 * size_t(b.corner[0][l]);
        for (int c = 0; c < 3; c++) {
            double* x = force + 3 * size_t(b.corner[c + 1][l]);
            for (int i = 0; i < 3; i++) x[i] += f[c][i][l], first[i] -= f[c][i][l];
        }
    }
}

PALPATE_INLINE double least(const Lane& J) {
    double value = J[0];
    for (int l = 1; l < TetBlock::lanes; l++) value = J[l] < value ? J[l] : value;
    return value;
}

// The nine numbers of each lane, adjacent, times its factor.
PALPATE_INLINE void store_nine(const Lane (&H)[3][3], const double* factor, double* out) {
    for (int l = 0; l < TetBlock::lanes; l++)
        for (int k = 0; k < 9; k++) out[9 * l + k] = factor[l] * H[k / 3][k % 3][l];
}

} // namespace palpate
