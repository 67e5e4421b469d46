#include "../factored_cube.h"
#include "../free_stiffness.h"
#include "../random_blocks.h"
#include "all_vertices.h"
#include "compliance/compliance_model.h"
#include <chrono>

using namespace palpate;

namespace {

// A model whose vertices are all nodes, at random positions in a box of 20 mm.
struct Organ {
    RandomBlocks K;
    SparseCholesky factor;
    ComplianceModel model;
    explicit Organ(int nodes, size_t budget)
        : K(nodes), factor(K.rows(), std::vector<double>(3 * nodes, 0.0).data()),
          model(all_vertices(factor, nodes), budget) {}
};

ContactPatch patch(std::vector<int> nodes, std::vector<double> weights) {
    ContactPatch out;
    out.count = int(nodes.size());
    std::copy(nodes.begin(), nodes.end(), out.node);
    std::copy(weights.begin(), weights.end(), out.weight);
    return out;
}

// The tool's force -S d, S = C^-1, C_ab = sum w_ai w_bj (K^-1)_ij, dense in float64.
std::vector<double> exact_force(const RandomBlocks& K, const std::vector<ContactPatch>& patches,
                                const std::vector<double>& displacement) {
    const int m = 3 * int(patches.size());
    std::vector<double> C(m * m, 0.0), d(displacement);
    for (int row = 0; row < m; row++) {
        std::vector<double> load(K.n, 0.0);
        for (int k = 0; k < patches[row / 3].count; k++)
            load[3 * patches[row / 3].node[k] + row % 3] += patches[row / 3].weight[k];
        const std::vector<double> u = solve_dense(K.dense, load);
        for (int c = 0; c < m; c++)
            for (int k = 0; k < patches[c / 3].count; k++)
                C[c * m + row] += patches[c / 3].weight[k] * u[3 * patches[c / 3].node[k] + c % 3];
    }
    std::vector<double> force = solve_dense(C, d);
    for (double& f : force) f = -f;
    return force;
}

} // namespace

TEST_CASE("the compliance model passes the patch test") {
    const std::vector<double> x = patch_test::positions();
    const SparseCholesky factor(patch_test::free_stiffness(), &x[12]);
    REQUIRE(factor.positive);
    patch_test::run_linear(ComplianceModel(patch_test::factored_cube(factor, x), 1 << 24), 1, 1, 1e-5);
}

TEST_CASE("forces on one and on two tools equal the dense compliance, and observed patches move as K u = f says") {
    const Organ organ(40, 1 << 24);
    const std::vector<ContactPatch> patches = {
        patch({3, 8, 21}, {0.5, 0.3, 0.2}), patch({5, 8, 30, 31}, {0.1, 0.2, 0.3, 0.4}), patch({12, 21}, {0.6, 0.4})};
    const std::vector<double> d = {0.4, -0.2, 1, 0.3, 0.7, -0.5};
    for (int tools : {1, 2}) {
        auto state = organ.model.make_state();
        std::vector<double> displacement(d), force(9);
        displacement.resize(9);
        REQUIRE(organ.model.relax(*state, patches.data(), tools, 3 - tools, displacement.data(), 1, force.data()));
        CHECK_FALSE(state->stale);
        const std::vector<double> given(d.begin(), d.begin() + 3 * tools);
        const std::vector<double> exact = exact_force(organ.K, {patches.begin(), patches.begin() + tools}, given);
        std::vector<double> load(organ.K.n, 0.0);
        for (int k = 0; k < 3 * tools; k++) {
            CHECK(force[k] == doctest::Approx(exact[k]).epsilon(1e-4));
            for (int i = 0; i < patches[k / 3].count; i++)
                load[3 * patches[k / 3].node[i] + k % 3] -= patches[k / 3].weight[i] * exact[k];
        }
        const std::vector<double> u = solve_dense(organ.K.dense, load);
        for (int k = 3 * tools; k < 9; k++) {
            double mean = 0;
            for (int i = 0; i < patches[k / 3].count; i++)
                mean += patches[k / 3].weight[i] * u[3 * patches[k / 3].node[i] + k % 3];
            CHECK(displacement[k] == doctest::Approx(mean).epsilon(1e-4).scale(0.1));
            CHECK(force[k] == 0);
        }
        std::vector<double> field(organ.K.n);
        organ.model.displacement(*state, field.data());
        for (int i = 0; i < organ.K.n; i++) CHECK(field[i] == doctest::Approx(u[i]).epsilon(1e-4).scale(0.1));
    }
}

TEST_CASE("a small budget evicts tables but changes no force") {
    const Organ large(60, 1 << 24), small(60, 30000);
    auto a = large.model.make_state(), b = small.model.make_state();
    const double d[3] = {0.2, 0.5, -1};
    for (int round = 0; round < 3; round++)
        for (int i = 0; i + 3 < 60; i += 3) {
            const ContactPatch p = patch({i, i + 1, i + 3}, {0.2, 0.3, 0.5});
            double force[2][3], displacement[2][3];
            std::copy_n(d, 3, displacement[0]), std::copy_n(d, 3, displacement[1]);
            REQUIRE(large.model.relax(*a, &p, 1, 0, displacement[0], 1, force[0]));
            REQUIRE(small.model.relax(*b, &p, 1, 0, displacement[1], 1, force[1]));
            for (int k = 0; k < 3; k++) CHECK(force[0][k] == force[1][k]);
        }
    CHECK(static_cast<ComplianceState&>(*a).greens[0]->evicted == 0);
    CHECK(static_cast<ComplianceState&>(*b).greens[0]->evicted > 0);
    CHECK(static_cast<ComplianceState&>(*b).greens[0]->bytes < static_cast<ComplianceState&>(*a).greens[0]->bytes);
}

TEST_CASE("tables that grow keep their blocks: forces as in a new state, to the bit") {
    const Organ organ(40, 1 << 24);
    int nearest = 1; // to vertex 0: a small table, which the wide patch makes larger
    for (int v = 2; v < 40; v++)
        if (organ.model.stiffness.distance(0, v) < organ.model.stiffness.distance(0, nearest)) nearest = v;
    const ContactPatch narrow = patch({0, nearest}, {0.9, 0.1}), other = patch({30, 31}, {0.4, 0.6}),
                       third = patch({20, 25}, {0.4, 0.6});
    ContactPatch wide;
    for (int v = 0; v < 40; v++) wide.node[v] = v, wide.weight[v] = (v + 1) / 820.0;
    wide.count = 40;
    const ContactPatch both[2] = {wide, narrow}; // the second is observed
    double force[2][6], d[2][6] = {{0.2, 0.5, -1}, {0.2, 0.5, -1}};
    auto grown = organ.model.make_state(), fresh = organ.model.make_state();
    for (const ContactPatch& p : {narrow, other, wide, other, third}) // others: until the state forgets the blocks
        REQUIRE(organ.model.relax(*grown, &p, 1, 0, d[0], 1, force[0]));
    for (int tick = 0; tick < 1000; tick++) REQUIRE(organ.model.relax(*grown, both, 1, 1, d[0], 1, force[0]));
    REQUIRE(organ.model.relax(*fresh, both, 1, 1, d[1], 1, force[1]));
    for (int k = 0; k < 3; k++) CHECK(force[0][k] == force[1][k]);
    for (int k = 3; k < 6; k++) CHECK(d[0][k] == d[1][k]);
}

TEST_CASE("after a tick without tables the force returns to the exact one in small steps") {
    const Organ organ(50, 1 << 24);
    auto state = organ.model.make_state();
    double force[3], before[3], d[3] = {0.2, 0.5, -1};
    const ContactPatch first = patch({3, 8, 21}, {0.5, 0.3, 0.2}), second = patch({5, 30, 31}, {0.3, 0.3, 0.4});
    REQUIRE(organ.model.relax(*state, &first, 1, 0, d, 1, force));
    state->tables = TablePolicy::unavailable;
    REQUIRE(organ.model.relax(*state, &second, 1, 0, d, 1, force));
    CHECK(state->stale);
    state->tables = TablePolicy::on_demand;
    const std::vector<double> exact = exact_force(organ.K, {second}, {d, d + 3});
    auto distance = [](const double* a, const double* b) {
        return std::sqrt(std::pow(a[0] - b[0], 2) + std::pow(a[1] - b[1], 2) + std::pow(a[2] - b[2], 2));
    };
    const double none[3] = {0, 0, 0};
    REQUIRE(distance(force, exact.data()) > 0.1 * distance(exact.data(), none));
    for (int tick = 0; tick < 1000; tick++) {
        std::copy_n(force, 3, before);
        REQUIRE(organ.model.relax(*state, &second, 1, 0, d, 1, force));
        CHECK(distance(force, before) < 0.016 * distance(exact.data(), none));
    }
    CHECK_FALSE(state->stale);
    CHECK_FALSE(state->blending);
    CHECK(distance(force, exact.data()) < 1e-4 * distance(exact.data(), none));
}

TEST_CASE("while tables are missing, observed patches stay where they were") {
    const Organ organ(50, 1 << 24);
    auto state = organ.model.make_state();
    const ContactPatch one = patch({12, 40}, {0.5, 0.5}), other = patch({17, 33}, {0.2, 0.8});
    const ContactPatch before[3] = {patch({3, 8, 21}, {0.5, 0.3, 0.2}), one, other},
                       after[3] = {patch({5, 30, 31}, {0.3, 0.3, 0.4}), one, other}; // the last two are observed
    double force[9], d[9] = {0.2, 0.5, -1};
    REQUIRE(organ.model.relax(*state, before, 1, 2, d, 1, force));
    const std::vector<double> moved(d, d + 9);
    CHECK(std::abs(moved[3] - moved[6]) > 1e-6);
    state->tables = TablePolicy::unavailable;
    for (int tick = 0; tick < 3; tick++) {
        REQUIRE(organ.model.relax(*state, after, 1, 2, d, 1, force));
        REQUIRE(state->stale);
        for (int k = 0; k < 9; k++) CHECK(d[k] == moved[k]);
    }
}

TEST_CASE("in real time the precomputed tables give the exact force") {
    const Organ organ(50, 1 << 24);
    auto state = organ.model.make_state();
    organ.model.begin_realtime(*state);
    double force[3], d[3] = {0.2, 0.5, -1};
    const ContactPatch p = patch({5, 30, 31}, {0.3, 0.3, 0.4});
    for (int tick = 0; tick < 20000 && (tick < 200 || state->stale || state->blending); tick++) {
        REQUIRE(organ.model.relax(*state, &p, 1, 0, d, 1, force));
        std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    const std::vector<double> exact = exact_force(organ.K, {p}, {d, d + 3});
    for (int k = 0; k < 3; k++) CHECK(force[k] == doctest::Approx(exact[k]).epsilon(0.05)); // blending ends at 2 %
    organ.model.end_realtime(*state);
}
