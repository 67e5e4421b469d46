#include "../random_blocks.h"
#include "hyperelastic/contact_constraints.h"
#include "linalg/sparse_cholesky.h"
#include <doctest.h>
#include <numeric>

using namespace palpate;

namespace {

constexpr int nodes = 30, contacts = 2;

struct Setting {
    RandomBlocks K{nodes};
    SparseCholesky factor{K.rows(), std::vector<double>(3 * nodes, 0.0).data()};
    FactorValues<float> value = factor.rounded();
    std::vector<int> all = std::vector<int>(nodes);
    ContactPatch patches[contacts];
    ContactConstraints constraints{nodes, 4};
    Setting() {
        std::iota(all.begin(), all.end(), 0);
        RestStiffness rest(factor.tree, value.data(), all, nodes);
        for (int c = 0; c < contacts; c++) {
            patches[c].count = 3;
            for (int k = 0; k < 3; k++)
                patches[c].node[k] = 4 + 12 * c + 3 * k, patches[c].weight[k] = 0.2 + 0.1 * k + 0.1 / 3;
        }
        REQUIRE(constraints.set_patches(patches, contacts, rest));
        REQUIRE(constraints.independent);
        CHECK_FALSE(constraints.set_patches(patches, contacts, rest));
    }
    double mean(const std::vector<double>& u, int row) const {
        double sum = 0;
        for (int k = 0; k < 3; k++) sum += patches[row / 3].weight[k] * u[3 * patches[row / 3].node[k] + row % 3];
        return sum;
    }
};

} // namespace

TEST_CASE("the move closes the gap, and no other one that does has less energy") {
    const Setting s;
    const double gap[6] = {1, -0.5, 0.3, 0.7, 0.2, -0.9};
    std::vector<double> move(3 * nodes), other = s.K.vector(5);
    s.constraints.least_energy_move(gap, move.data());
    for (int row = 0; row < 6; row++) CHECK(s.mean(move, row) == doctest::Approx(gap[row]).epsilon(1e-10));
    s.constraints.project(other.data());
    for (int row = 0; row < 6; row++) CHECK(std::abs(s.mean(other, row)) < 1e-10);
    const std::vector<double> force = s.K.times(move); // orthogonal to all that moves no tool
    double along = 0, size = 0;
    for (int i = 0; i < 3 * nodes; i++) along += force[i] * other[i], size += force[i] * move[i];
    CHECK(std::abs(along) < 1e-4 * size); // float32 factors
}

TEST_CASE("what is left of a gradient without the tools' forces moves no tool") {
    const Setting s;
    const std::vector<double> before = s.K.vector(6);
    std::vector<double> g = before;
    double force[6];
    s.constraints.subtract_tool_forces(g.data(), force);
    const std::vector<double> u = solve_dense(s.K.dense, g);
    const std::vector<double> all = solve_dense(s.K.dense, before);
    for (int row = 0; row < 6; row++) CHECK(std::abs(s.mean(u, row)) < 1e-4 * (0.01 + std::abs(s.mean(all, row))));
    for (int row = 0; row < 6; row++)
        for (int k = 0; k < 3; k++) {
            const int i = 3 * s.patches[row / 3].node[k] + row % 3;
            CHECK(before[i] - g[i] == doctest::Approx(s.patches[row / 3].weight[k] * force[row]).epsilon(1e-10));
        }
}
