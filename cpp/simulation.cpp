#include "simulation.h"
#include <algorithm>
#include <cmath>
#include <cstring>

namespace palpate {
namespace {

double length(const double v[3]) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

} // namespace

Simulation::Simulation(const Model& model, const Surface& surface, const Settings& settings)
    : settings(settings), model(model), surface(surface), state(model.start()), scratch(surface.scratch()) {}

void Simulation::tick(const Command& command) {
    follow(proxy, command, surface, settings.radius, settings.pace, scratch);
    bool holding = proxy.grip == Proxy::Grip::holding;
    double none[3] = {0, 0, 0};
    model.advance(*state, holding ? &proxy.patch : nullptr, holding ? proxy.displacement : none, settings.sweeps, force);
    if (!holding) std::fill_n(force, 3, 0.0);
    watch();
    push();
    ticks++;
}

void Simulation::watch() {
    double sum = force[0] + force[1] + force[2];
    for (double x : state->u) sum += x;
    if (std::isfinite(sum)) return;
    faults++;
    std::fill(state->u.begin(), state->u.end(), 0.0);
    std::fill_n(force, 3, 0.0);
    proxy.grip = Proxy::Grip::refused; // the hand must let go first
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
    for (double x : state->u) mix(x);
    for (double x : force) mix(x);
    return hash;
}

} // namespace palpate
