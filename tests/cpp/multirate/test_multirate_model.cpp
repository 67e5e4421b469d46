#include "../factored_cube.h"
#include "../free_stiffness.h"
#include "hyperelastic/neo_hookean.h"
#include "multirate/multirate_model.h"
#include <cmath>

using namespace palpate;

namespace {

struct Cube : patch_test::Mesh {
    NeoHookean elements{x.data(), patch_test::nodes, tet.data(), patch_test::tets, lambda_of.data(), mu_of.data()};
    SparseCholesky factor{patch_test::free_stiffness(), &x[12]};
    ComplianceModel linear{patch_test::factored_cube(factor, x), size_t(1) << 20};
    HyperelasticModel finite{elements, factor, {4, 5, 6, 7, 8}};
};

ContactPatch corner() {
    ContactPatch out;
    out.count = 1, out.node[0] = patch_test::top[0], out.weight[0] = 1;
    return out;
}

} // namespace

TEST_CASE("a held contact settles on the force at finite strain") {
    const Cube cube;
    const MultirateModel model(cube.linear, cube.finite, 10, 4.0);
    auto state = model.make_state();
    auto equilibrium = cube.finite.make_state();
    const ContactPatch patch = corner();
    double wanted[3] = {0.5, -0.3, -3}, force[3], exact[3], linear[3];
    REQUIRE(cube.finite.solve(*equilibrium, &patch, 1, wanted, 200, 1e-9, exact) >= 0);
    auto unbent = cube.linear.make_state();
    double d[3];
    std::copy_n(wanted, 3, d);
    REQUIRE(cube.linear.relax(*unbent, &patch, 1, 0, d, 1, linear));
    for (int tick = 0; tick < 200; tick++) {
        std::copy_n(wanted, 3, d);
        REQUIRE(model.relax(*state, &patch, 1, 0, d, 1, force));
        if (tick == 0) CHECK(force[2] == doctest::Approx(linear[2]).epsilon(1e-12)); // no solution is there yet
    }
    for (int k = 0; k < 3; k++) CHECK(force[k] == doctest::Approx(exact[k]).epsilon(1e-2).scale(std::abs(exact[2])));
    CHECK(std::abs(linear[2] / exact[2] - 1) > 0.05);
    CHECK(state->solution_age >= 10);
}

TEST_CASE("by the clock another thread solves, and a replay of its events gives the same bits") {
    const Cube cube;
    const MultirateModel model(cube.linear, cube.finite, 10, 4.0);
    auto live = model.make_state(), replayed = model.make_state();
    const ContactPatch patch = corner();
    constexpr int ticks = 400;
    std::vector<int> events(ticks), stale(ticks);
    std::vector<double> felt(3 * ticks);
    float shown[12];
    const auto touch = [&](ModelState& state, int tick, double* force) {
        double d[3] = {0, 0, -3 * std::sin(0.02 * tick)};
        const int held = tick % 150 < 120; // lets go now and then
        std::fill_n(force, 3, 0.0);
        REQUIRE(model.relax(state, &patch, held, 0, d, 1, force));
        model.displayed_displacement(state, patch_test::top, 4, shown); // reads what the thread may be about to write
        REQUIRE(std::isfinite(shown[2]));
    };
    model.begin_realtime(*live);
    for (int tick = 0; tick < ticks; tick++) {
        touch(*live, tick, &felt[3 * tick]);
        events[tick] = live->events, stale[tick] = live->stale;
        std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    model.end_realtime(*live);
    int taken = 0;
    for (int tick = 0; tick < ticks; tick++) {
        double force[3];
        replayed->recorded_events = events[tick];
        replayed->tables = stale[tick] ? TablePolicy::unavailable : TablePolicy::on_demand;
        touch(*replayed, tick, force);
        for (int k = 0; k < 3; k++) REQUIRE(force[k] == felt[3 * tick + k]);
        taken += events[tick] >> 1 & 1;
    }
    CHECK(taken > 3);
}
