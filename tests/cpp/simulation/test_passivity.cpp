// Passivity of the loop (cpp/simulation/passivity.cpp): whatever a user does with a tool, the tissue gives back no more
// energy than was put in. The tissue is a stub whose stiffness rises along x: without the passivity functions a user
// who slides a pressed tool from soft to stiff and lets go gains energy in every cycle.
#include "base/vec3.h"
#include "simulation/simulation.h"
#include <cmath>
#include <doctest.h>
#include <random>

using namespace palpate;

namespace {

constexpr int side = 31;
constexpr double spacing = 2, radius = 6, from = 12, to = 48; // mm; contacts stay between `from` and `to`

std::vector<double> grid() {
    std::vector<double> x;
    for (int i = 0; i < side; i++)
        for (int j = 0; j < side; j++) x.insert(x.end(), {spacing * i, spacing * j, 0.0});
    return x;
}

ContactSurface plane() {
    std::vector<int32_t> triangles;
    for (int i = 0; i + 1 < side; i++)
        for (int j = 0; j + 1 < side; j++) {
            const int a = side * i + j, b = a + side;
            triangles.insert(triangles.end(), {a, b, a + 1, b, b + 1, a + 1});
        }
    const std::vector<double> x = grid();
    const std::vector<uint8_t> fixed(side * side, 0);
    return {x.data(), side * side, triangles.data(), int(triangles.size() / 3), fixed.data()};
}

// One spring under the contact: 0.05 N/mm at `from`, four times that at `to`.
struct Stub : TissueModel {
    int nodes() const override { return side * side; }
    std::unique_ptr<ModelState> make_state() const override {
        auto state = std::make_unique<ModelState>();
        state->u.assign(3, 0.0);
        state->owner = this;
        return state;
    }
    bool relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed, double* displacement, int,
               double* force) const override {
        if (prescribed > 1 || observed > 0) return false;
        std::fill(state.u.begin(), state.u.end(), 0.0);
        if (!prescribed) return true;
        double x = 0;
        for (int i = 0; i < patches[0].count; i++) x += patches[0].weight[i] * spacing * (patches[0].node[i] / side);
        const double stiffness = 0.05 * (1 + 3 * (x - from) / (to - from));
        for (int k = 0; k < 3; k++) state.u[k] = displacement[k], force[k] = -stiffness * displacement[k];
        return true;
    }
};

struct Meter { // the test's own account, N mm: work of the tool, of the model's force alone, largest stored energy
    double work = 0, model_work = 0, stored = 0;
    bool closed = false;
    double tip[3] = {}, total[3] = {}, model[3] = {};

    void read(const ToolProxy& tool) {
        double now[3];
        tool.total_force(now);
        const bool closes = tool.state == ContactState::closed;
        for (int k = 0; k < 3; k++) {
            if (closed && closes) {
                work -= 0.5 * (now[k] + total[k]) * (tool.tip[k] - tip[k]);
                model_work -= 0.5 * (tool.force[k] + model[k]) * (tool.tip[k] - tip[k]);
            }
            tip[k] = tool.tip[k], total[k] = now[k], model[k] = tool.force[k];
        }
        closed = closes;
        stored = std::max(stored, -0.5 * dot(tool.force, tool.displacement));
    }
};

void run(Simulation& simulation, Meter& meter, const Command& command, int ticks) {
    Commands commands;
    commands.tool[0] = command;
    for (int t = 0; t < ticks; t++) {
        simulation.tick(commands);
        meter.read(simulation.proxy[0]);
    }
}

Simulation simulation_on(const Stub& stub, const ContactSurface& surface) {
    SimulationSettings settings;
    settings.tools.radius = radius;
    return {stub, surface, settings};
}

Command hold(double x, double y, double depth) { return {CommandKind::hold, {x, y, 0}, {0, 0, -depth}}; }

} // namespace

TEST_CASE("sliding a pressed tool from soft to stiff tissue and letting go gains no energy") {
    const Stub stub;
    const ContactSurface surface = plane();
    auto simulation = simulation_on(stub, surface);
    for (int cycle = 0; cycle < 5; cycle++) {
        Meter meter;
        const double before = simulation.work;
        run(simulation, meter, hold(from, 30, 0), 200);
        run(simulation, meter, hold(from, 30, 4), 200);
        for (double x = from; x <= to; x += 0.25) run(simulation, meter, hold(x, 30, 4), 8);
        run(simulation, meter, hold(to, 30, 0), 200);
        run(simulation, meter, {}, 50);
        CHECK(meter.stored > 1);
        CHECK(meter.model_work < -0.5 * meter.stored); // so much the model's force alone would have given away
        CHECK(meter.work > -1e-4 * meter.stored);      // drag alone leaves -9e-4, the passivity controller alone -3e-3
        CHECK(std::abs(simulation.work - before - meter.work) < 0.01 * meter.stored); // the observer's count
    }
}

TEST_CASE("random commands gain no energy") {
    const Stub stub;
    const ContactSurface surface = plane();
    double worst = 0;
    int gains = 0; // episodes in which the model's force alone would have given energy away
    for (int seed = 1; seed <= 10; seed++) {
        CAPTURE(seed);
        std::mt19937 random(seed);
        std::uniform_real_distribution<double> share(0, 1);
        auto simulation = simulation_on(stub, surface);
        for (int episode = 0; episode < 20; episode++) {
            Meter meter;
            double x = from + (to - from) * share(random), y = 20 + 20 * share(random), depth = 0;
            for (int part = 0; part < 8; part++) { // slides and presses at the speeds of a hand
                const double x_to = from + (to - from) * share(random), y_to = 20 + 20 * share(random);
                const double depth_to = 5 * share(random);
                const int steps = 10 + int(60 * share(random));
                for (int s = 1; s <= steps; s++) {
                    const double t = double(s) / steps;
                    run(simulation, meter, hold(x + t * (x_to - x), y + t * (y_to - y), depth + t * (depth_to - depth)),
                        8);
                }
                x = x_to, y = y_to, depth = depth_to;
            }
            run(simulation, meter, hold(x, y, 0), 100);
            run(simulation, meter, {}, 20);
            worst = std::min(worst, meter.work / meter.stored);
            gains += meter.model_work < -0.1 * meter.stored;
        }
    }
    CHECK(worst > -1e-4);
    CHECK(gains > 50); // of 200
}

TEST_CASE("a still tool feels the model's force alone") {
    const Stub stub;
    const ContactSurface surface = plane();
    auto simulation = simulation_on(stub, surface);
    Meter meter;
    run(simulation, meter, hold(30, 30, 4), 300);
    double total[3];
    simulation.proxy[0].total_force(total);
    const double stiffness = 0.05 * (1 + 3 * (30 - from) / (to - from));
    CHECK(total[2] == doctest::Approx(4 * stiffness).epsilon(1e-3));
    CHECK(total[0] == doctest::Approx(0).epsilon(1e-6));
}
