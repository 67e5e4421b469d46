#include "../patch_test.h"
#include "multirate/linear_multirate_model.h"
#include <cmath>

using namespace palpate;

namespace {

struct Cube : patch_test::Mesh {
    MultigridModel iterative{
        {x.data(), tet.data(), lambda_of.data(), mu_of.data(), fixed.data(), patch_test::nodes, patch_test::tets},
        patch_test::edge,
        2,
        1.0};
};

ContactPatch at_corner(int k) {
    ContactPatch out;
    out.count = 1, out.node[0] = patch_test::top[k], out.weight[0] = 1;
    return out;
}

} // namespace

TEST_CASE("by the clock another thread iterates, and a replay of its events gives the same bits") {
    const Cube cube;
    const LinearMultirateModel model(cube.iterative, 10, cube.x, std::vector<double>(patch_test::nodes, patch_test::mu),
                                     {});
    auto live = model.make_state(), replayed = model.make_state();
    const ContactPatch patches[3] = {at_corner(0), at_corner(2), at_corner(2)};
    constexpr int ticks = 400;
    std::vector<int> events(ticks), held(ticks);
    std::vector<double> felt(9 * ticks);
    float shown[12];
    // As Simulation does it: a contact that is refused, since it is where another one is, stays away.
    int refused = 3;
    const auto touch = [&](ModelState& state, int tick, double* force) {
        double d[9] = {0, 0, -3 * std::sin(0.02 * tick), 0, 0.2, -1, 0, 0, -0.5};
        if (tick % 100 == 0) refused = 3;
        int count = std::min(tick % 100 < 80 ? tick % 100 / 25 : 0, refused);
        std::fill_n(force, 9, 0.0);
        if (!model.relax(state, patches, count, 0, d, 1, force)) {
            REQUIRE(count == 3);
            refused = count = 2;
            REQUIRE(model.relax(state, patches, count, 0, d, 1, force));
        }
        model.displayed_displacement(state, patch_test::top, 4, shown); // reads what the thread may be about to write
        REQUIRE(std::isfinite(shown[2]));
        return count;
    };
    model.begin_realtime(*live);
    for (int tick = 0; tick < ticks; tick++) {
        held[tick] = touch(*live, tick, &felt[9 * tick]);
        events[tick] = live->events;
        std::this_thread::sleep_for(std::chrono::microseconds(300));
    }
    model.end_realtime(*live);
    int taken = 0;
    for (int tick = 0; tick < ticks; tick++) {
        double force[9];
        replayed->recorded_events = events[tick];
        REQUIRE(touch(*replayed, tick, force) == held[tick]);
        for (int k = 0; k < 9; k++) REQUIRE(force[k] == felt[9 * tick + k]);
        taken += events[tick] >> 1 & 1;
    }
    CHECK(taken > 3);
}
