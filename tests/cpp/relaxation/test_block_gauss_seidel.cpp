#include "../patch_test.h"
#include "../random_blocks.h"
#include "relaxation/block_gauss_seidel.h"

using namespace palpate;

namespace {

constexpr int nodes = 30;

std::vector<ContactPatch> two_patches() {
    std::vector<ContactPatch> out(2);
    for (int c = 0; c < 2; c++) {
        out[c].count = 4;
        for (int k = 0; k < 4; k++) out[c].node[k] = 3 + 14 * c + 2 * k, out[c].weight[k] = 0.1 * (k + 1);
    }
    return out;
}

} // namespace

TEST_CASE("block Gauss-Seidel passes the patch test") {
    const std::vector<double> K = patch_test::dense_stiffness();
    BlockCsr rows;
    for (int i = 0; i < patch_test::nodes; i++) {
        for (int j = 0; j < patch_test::nodes; j++) {
            rows.column.push_back(j);
            for (int e = 0; e < 9; e++)
                rows.block.push_back(K[(3 * i + e / 3) * 3 * patch_test::nodes + 3 * j + e % 3]);
        }
        rows.start.push_back(int(rows.column.size()));
    }
    std::vector<uint8_t> fixed(patch_test::nodes, 0);
    for (int i = 0; i < 4; i++) fixed[i] = 1;
    patch_test::run_linear(BlockGaussSeidel(rows, fixed, 1.2, ModeDeflation()), 1, 60, 1e-9);
}

TEST_CASE("sweeps lower the energy, keep W'u = d, and converge to the solution of K u = W f") {
    const RandomBlocks K(nodes);
    const std::vector<ContactPatch> patches = two_patches();
    const double displacement[6] = {0.3, -1, 0.5, 0.2, 0.8, -0.4};
    const BlockGaussSeidel model(K.rows(), std::vector<uint8_t>(nodes, 0), 1.3, ModeDeflation());
    auto state = model.make_state();
    double force[6], before = 1e300;
    auto mean = [&](const std::vector<double>& u, int row) {
        double sum = 0;
        for (int k = 0; k < 4; k++) sum += patches[row / 3].weight[k] * u[3 * patches[row / 3].node[k] + row % 3];
        return sum;
    };
    for (int sweep = 0; sweep < 400; sweep++) {
        REQUIRE(model.solve(*state, patches.data(), 2, displacement, 1, force));
        const std::vector<double> f = K.times(state->u);
        double energy = 0;
        for (int i = 0; i < K.n; i++) energy += state->u[i] * f[i] / 2;
        CHECK(energy <= before * (1 + 1e-12));
        before = energy;
        for (int row = 0; row < 6; row++)
            CHECK(mean(state->u, row) == doctest::Approx(displacement[row]).epsilon(1e-9));
    }
    // The saddle point [K W; W' 0] (u, -f) = (0, d), dense.
    const int n = K.n + 6;
    std::vector<double> A(size_t(n) * n, 0.0), b(n, 0.0);
    for (int i = 0; i < K.n; i++)
        for (int j = 0; j < K.n; j++) A[size_t(i) * n + j] = K(i, j);
    for (int row = 0; row < 6; row++) {
        b[K.n + row] = displacement[row];
        for (int k = 0; k < 4; k++) {
            const int i = 3 * patches[row / 3].node[k] + row % 3;
            A[size_t(i) * n + K.n + row] = A[size_t(K.n + row) * n + i] = patches[row / 3].weight[k];
        }
    }
    const std::vector<double> exact = solve_dense(A, b);
    for (int i = 0; i < K.n; i++) CHECK(state->u[i] == doctest::Approx(exact[i]).epsilon(1e-6).scale(1));
    for (int row = 0; row < 6; row++) CHECK(force[row] == doctest::Approx(exact[K.n + row]).epsilon(1e-6));
}
