#include "multigrid/fem_stiffness.h"
#include "base/cpu_dispatch.h"
#include "tissue/tetrahedron.h"
#include <algorithm>
#include <cmath>

namespace palpate {

double shape_gradients(const ElasticMesh& mesh, int t, double g[4][3]) {
    const double volume = shape_gradients(mesh.node, mesh.tet + 4 * size_t(t), g + 1);
    for (int k = 0; k < 3; k++) g[0][k] = 0 - g[1][k] - g[2][k] - g[3][k];
    return std::abs(volume);
}

void add_stiffness(double lam, double mu, const double g[3], const double h[3], double* out) {
    double inner = mu * (g[0] * h[0] + g[1] * h[1] + g[2] * h[2]);
    for (int a = 0; a < 3; a++) {
        for (int b = 0; b < 3; b++) out[3 * a + b] += lam * g[a] * h[b] + mu * h[a] * g[b];
        out[4 * a] += inner;
    }
}

BlockCsr assemble_stiffness(const ElasticMesh& mesh) {
    std::vector<std::vector<int>> neighbours(mesh.nodes);
    for (int t = 0; t < mesh.tets; t++)
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < 4; b++) neighbours[mesh.tet[4 * size_t(t) + a]].push_back(mesh.tet[4 * size_t(t) + b]);
    BlockCsr K;
    for (auto& row : neighbours) {
        std::sort(row.begin(), row.end());
        row.erase(std::unique(row.begin(), row.end()), row.end());
        K.column.insert(K.column.end(), row.begin(), row.end());
        K.start.push_back(int(K.column.size()));
    }
    K.block.assign(9 * K.column.size(), 0);
    for (int t = 0; t < mesh.tets; t++) {
        double g[4][3];
        const double volume = shape_gradients(mesh, t, g);
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < 4; b++) {
                const int i = mesh.tet[4 * size_t(t) + a], j = mesh.tet[4 * size_t(t) + b];
                auto at = std::lower_bound(K.column.begin() + K.start[i], K.column.begin() + K.start[i + 1], j);
                add_stiffness(volume * mesh.lam[t], volume * mesh.mu[t], g[a], g[b],
                              &K.block[9 * (at - K.column.begin())]);
            }
    }
    return K;
}

PALPATE_KERNEL void multiply_rows(const BlockCsr& K, int first, int last, const double* u, double* out) {
    const int *start = K.start.data(), *column = K.column.data();
    const double* block = K.block.data();
    for (int i = first; i < last; i++) {
        double sum[3] = {0, 0, 0};
        for (int k = start[i]; k < start[i + 1]; k++) {
            const double *b = block + 9 * size_t(k), *v = u + 4 * size_t(column[k]);
            for (int a = 0; a < 3; a++) sum[a] += b[3 * a] * v[0] + b[3 * a + 1] * v[1] + b[3 * a + 2] * v[2];
        }
        for (int a = 0; a < 3; a++) out[4 * size_t(i) + a] = sum[a];
    }
}

} // namespace palpate
