#include "simulation.h"
#include <algorithm>
#include <cmath>
#include <cstring>

namespace palpate {
namespace {

constexpr double nearly_home = 1e-6; // mm: what is left of a displacement when the tissue counts as at rest

double length(const double v[3]) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

} // namespace

Simulation::Simulation(const Model& model, const Surface& surface, const Settings& settings)
    : settings(settings), model(model), surface(surface), state(model.start()), scratch(surface.scratch()) {}

void Simulation::tick(const Command& command) {
    follow(proxy, command, surface, settings.radius, settings.pace, scratch);
    bool holding = proxy.grip == Proxy::Grip::holding;
    if (holding || !home) {
        double none[3] = {0, 0, 0};
        model.advance(*state, holding ? &proxy.patch : nullptr, holding ? proxy.displacement : none, settings.sweeps,
                      force);
        if (!holding) std::fill_n(force, 3, 0.0);
        watch(holding);
    }
    push();
    ticks++;
}

void Simulation::watch(bool holding) {
    double sum = force[0] + force[1] + force[2], most = 0;
    for (double x : state->memory()) {
        sum += x;
        most = std::max(most, std::abs(x));
    }
    bool sound = std::isfinite(sum);
    if (!sound) {
        faults++;
        std::fill_n(force, 3, 0.0);
        proxy.grip = Proxy::Grip::refused; // the hand must let go first
    }
    home = !sound || (!holding && most < nearly_home);
    if (home) state->rest();
}

void Simulation::push() {
    double wanted = length(force), before = length(pushed);
    double allowed = std::min({wanted, settings.limit, before + settings.ramp});
    for (int k = 0; k < 3; k++) pushed[k] = wanted > 0 ? force[k] * (allowed / wanted) : 0;
}

uint64_t Simulation::digest() const {
    uint64_t hash = 0x9e3779b97f4a7c15;
    auto mix = [&](double value) {
        uint64_t bits;
        std::memcpy(&bits, &value, sizeof bits);
        hash = (hash ^ bits) * 0xff51afd7ed558ccd;
        hash ^= hash >> 32;
    };
    for (double x : state->memory()) mix(x);
    for (double x : force) mix(x);
    return hash;
}

} // namespace palpate
