// The patch test of finite elements (B. Irons & S. Ahmad, Techniques of Finite Elements, 1980): a cube with one
// interior node off its centre. The bottom is fixed and the four top corners are moved so that the exact solution is
// linear in z.
#pragma once
#include "tissue/tissue_model.h"
#include <doctest.h>
#include <vector>

namespace palpate::patch_test {

constexpr int nodes = 9, tets = 12, interior = 8;
constexpr double edge = 10, lambda = 3e-3, mu = 1e-3; // mm, N/mm^2
const int top[4] = {4, 5, 6, 7};

inline std::vector<double> positions() {
    std::vector<double> x;
    for (int i = 0; i < 8; i++) x.insert(x.end(), {edge * (i & 1), edge * (i >> 1 & 1), edge * (i >> 2 & 1)});
    x.insert(x.end(), {4.1, 6.3, 3.7});
    return x;
}

// The cube's twelve surface triangles, outward, each with the interior node.
inline std::vector<int> tetrahedra() {
    const int face[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    std::vector<int> out;
    for (const int* f : face) {
        out.insert(out.end(), {f[0], f[2], f[1], interior});
        out.insert(out.end(), {f[0], f[3], f[2], interior});
    }
    return out;
}

// The arrays that models are made of.
struct Mesh {
    std::vector<double> x = positions();
    std::vector<int> tet = tetrahedra();
    std::vector<double> lambda_of = std::vector<double>(tets, lambda), mu_of = std::vector<double>(tets, mu);
    std::vector<uint8_t> fixed{1, 1, 1, 1, 0, 0, 0, 0, 0}; // the bottom
};

// The stiffness among all nodes, (3 nodes, 3 nodes), dense: sum of V B' D B in Voigt notation.
inline std::vector<double> dense_stiffness() {
    const std::vector<double> x = positions();
    const std::vector<int> tet = tetrahedra();
    std::vector<double> K(9 * nodes * nodes, 0.0);
    for (int t = 0; t < tets; t++) {
        const int* v = &tet[4 * t];
        double e[3][3], inverse[3][3], g[4][3];
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++) e[c][k] = x[3 * v[c + 1] + k] - x[3 * v[0] + k];
        double det = 0;
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++)
                inverse[k][c] = e[(c + 1) % 3][(k + 1) % 3] * e[(c + 2) % 3][(k + 2) % 3] -
                                e[(c + 1) % 3][(k + 2) % 3] * e[(c + 2) % 3][(k + 1) % 3];
        for (int k = 0; k < 3; k++) det += e[0][k] * inverse[k][0];
        REQUIRE(det > 0);
        for (int k = 0; k < 3; k++) {
            g[0][k] = 0;
            for (int c = 0; c < 3; c++) g[c + 1][k] = inverse[k][c] / det, g[0][k] -= g[c + 1][k];
        }
        double B[6][12] = {};
        for (int a = 0; a < 4; a++) {
            for (int k = 0; k < 3; k++) B[k][3 * a + k] = g[a][k];
            B[3][3 * a] = g[a][1], B[3][3 * a + 1] = g[a][0];
            B[4][3 * a + 1] = g[a][2], B[4][3 * a + 2] = g[a][1];
            B[5][3 * a] = g[a][2], B[5][3 * a + 2] = g[a][0];
        }
        for (int p = 0; p < 12; p++)
            for (int q = 0; q < 12; q++) {
                double sum = 0;
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++) sum += B[i][p] * (lambda + (i == j ? 2 * mu : 0)) * B[j][q];
                for (int i = 3; i < 6; i++) sum += B[i][p] * mu * B[i][q];
                K[(3 * v[p / 3] + p % 3) * 3 * nodes + 3 * v[q / 3] + q % 3] += det / 6 * sum;
            }
    }
    return K;
}

// Runs `iterations` of the model with u = slope z at the top corners. Checks the interior node's displacement, and the
// sum of the forces against the traction (3) N/mm^2 on the top.
inline void run(const TissueModel& model, const double slope[3], const double traction[3], int calls, int iterations,
                double tolerance) {
    ContactPatch patches[4];
    double displacement[12], force[12];
    for (int c = 0; c < 4; c++) {
        patches[c].count = 1, patches[c].node[0] = top[c], patches[c].weight[0] = 1;
        for (int k = 0; k < 3; k++) displacement[3 * c + k] = slope[k] * edge;
    }
    auto state = model.make_state();
    CHECK(model.owns(*state));
    for (int call = 0; call < calls; call++)
        REQUIRE(model.relax(*state, patches, 4, 0, displacement, iterations, force));
    std::vector<double> u(3 * nodes);
    model.displacement(*state, u.data());
    const std::vector<double> x = positions();
    for (int k = 0; k < 3; k++) {
        CHECK(u[3 * interior + k] == doctest::Approx(slope[k] * x[3 * interior + 2]).epsilon(tolerance));
        double sum = 0;
        for (int c = 0; c < 4; c++) sum += force[3 * c + k];
        CHECK(sum == doctest::Approx(-traction[k] * edge * edge).epsilon(tolerance));
    }
    CHECK(model.energy(*state, 4, displacement, force) > 0);
}

// Linear elasticity under u = slope z: strains slope/2 and slope[2], constant stress.
inline void run_linear(const TissueModel& model, int calls, int iterations, double tolerance) {
    const double slope[3] = {0.05, -0.02, -0.1};
    const double traction[3] = {mu * slope[0], mu * slope[1], (lambda + 2 * mu) * slope[2]};
    run(model, slope, traction, calls, iterations, tolerance);
}

} // namespace palpate::patch_test
