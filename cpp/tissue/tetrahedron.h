#pragma once
// Linear tetrahedra. MultigridModel and NeoHookean use it when they are made, on the caller's thread.
#include <cstddef>
#include <cstdint>

namespace palpate {

// The gradients of the last three corners' shape functions, 1/mm: rows of the inverse of the edges. Returns the volume,
// which is negative if the corners are in the other order.
inline double shape_gradients(const double* nodes, const int32_t* tet, double g[3][3]) {
    double e[3][3];
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 3; k++) e[c][k] = nodes[3 * size_t(tet[c + 1]) + k] - nodes[3 * size_t(tet[0]) + k];
    double det = 0;
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 3; k++) {
            const int c1 = (c + 1) % 3, c2 = (c + 2) % 3, k1 = (k + 1) % 3, k2 = (k + 2) % 3;
            g[c][k] = e[c1][k1] * e[c2][k2] - e[c1][k2] * e[c2][k1];
            if (c == 0) det += e[0][k] * g[0][k];
        }
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 3; k++) g[c][k] /= det;
    return det / 6;
}

} // namespace palpate
