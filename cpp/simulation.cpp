#include "simulation.h"
#include "vector.h"
#include <algorithm>
#include <cmath>
#include <cstring>

namespace palpate {
namespace {

using Grip = Proxy::Grip;
constexpr double nearly_home = 1e-6; // mm: what is left of a displacement when the tissue counts as at rest

} // namespace

Simulation::Simulation(const Model& model, const Surface& surface, const Settings& settings)
    : settings(settings), surface(surface), now{&model, model.start(), settings.sweeps}, scratch(surface.scratch()) {}

void Simulation::tick(const Commands& commands) {
    const bool known = !now.state->cold;
    for (int t = 0; t < most_tools; t++) {
        bool others = !home;
        for (int o = 0; o < most_tools; o++) others = others || (o != t && proxy[o].grip == Grip::holding);
        const bool held = proxy[t].grip == Grip::holding;
        follow(proxy[t], commands.tool[t], surface, settings.manner, others && !held, known, scratch);
        if (!held && proxy[t].grip == Grip::holding) proxy[t].landed = ticks;
    }
    gather();
    if (closed > 0 || !home) {
        while (!answer()) { // the contact that came last cannot be told from the others
            proxy[who[closed - 1]].grip = Grip::refused;
            gather();
        }
        learn_slopes();
        account();
        watch();
    } else {
        for (int c = 0; c < open; c++) std::fill_n(proxy[who[c]].displacement, 3, 0.0);
        account();
    }
    push();
    ticks++;
}

// A hand glides towards its command, so that the one it obeys now says where the next tick finds it; a tool in space is
// where its command is.
void Simulation::look_ahead(const Commands& commands) {
    int count = 0;
    bool any = false;
    for (int t = 0; t < most_tools; t++) {
        const Command &now = commands.tool[t], &then = before.tool[t];
        if (proxy[t].grip != Grip::holding && proxy[t].grip != Grip::open) continue;
        Command next = now;
        if (now.kind == Command::Kind::free && then.kind == Command::Kind::free)
            for (int k = 0; k < 3; k++) next.point[k] += now.point[k] - then.point[k];
        soon[t] = proxy[t];
        follow(soon[t], next, surface, settings.manner, false, !this->now.state->cold, scratch);
        if (soon[t].grip != Grip::holding && soon[t].grip != Grip::open) continue;
        any = any || soon[t].grip == Grip::holding;
        patch[count++].copy(soon[t].patch);
    }
    before = commands;
    if (!any) return;
    now.model->expect(*now.state, patch, count);
    if (next.model) next.model->expect(*next.state, patch, count);
}

void Simulation::gather() {
    closed = open = 0;
    for (int t = 0; t < most_tools; t++) {
        if (proxy[t].grip != Grip::holding) continue;
        int at = closed++;
        for (; at > 0 && proxy[who[at - 1]].landed > proxy[t].landed; at--) who[at] = who[at - 1];
        who[at] = t;
    }
    for (int t = 0; t < most_tools; t++)
        if (proxy[t].grip == Grip::open) who[closed + open++] = t;
    for (int c = 0; c < closed + open; c++) {
        const Proxy& p = proxy[who[c]];
        patch[c].copy(p.patch);
        std::copy_n(p.displacement, 3, moved + 3 * c);
        std::fill_n(force + 3 * c, 3, 0.0);
    }
}

bool Simulation::answer() {
    if (!now.model->advance(*now.state, patch, closed, open, moved, now.sweeps, force)) {
        if (closed > 1) return false;
        if (closed == 1) proxy[who[0]].grip = Grip::refused; // not even alone
        gather();
        std::fill_n(force, 3 * most_tools, 0.0);
    }
    lacking = now.state->cold;
    if (next.model) bring_in();
    for (int t = 0; t < most_tools; t++) std::fill_n(proxy[t].force, 3, 0.0);
    for (int c = 0; c < closed + open; c++) {
        Proxy& p = proxy[who[c]];
        std::copy_n(force + 3 * c, 3, p.force);
        if (c < closed && p.kind == Command::Kind::free) part(p);
        if (c >= closed) std::copy_n(moved + 3 * c, 3, p.displacement);
    }
    return true;
}

// A tool in space that would be pulled leaves the tissue.
void Simulation::part(Proxy& p) const {
    double out[3];
    surface.normal(p.at, out);
    if (dot(p.force, out) >= 0) return;
    p.grip = Grip::open;
    std::fill_n(p.force, 3, 0.0);
    std::fill_n(p.slope, 3, 0.0);
}

// The model that comes runs beside the other, first unfelt, then with a growing share of the force.
void Simulation::bring_in() {
    double same[3 * most_tools];
    std::copy_n(moved, 3 * most_tools, same);
    const bool good = next.model->advance(*next.state, patch, closed, open, same, next.sweeps, other_force);
    lacking |= next.state->cold << 1;
    since++;
    const double share = std::clamp(double(since - settle) / blend, 0.0, 1.0);
    if (good)
        for (int k = 0; k < 3 * closed; k++) force[k] += share * (other_force[k] - force[k]);
    if (since < settle + blend) return;
    old = std::move(now);
    now = std::move(next);
    next = Running();
}

void Simulation::watch() {
    double sum = 0, most = 0;
    for (int k = 0; k < 3 * closed; k++) sum += force[k];
    for (const Running* r : {&now, &next})
        if (r->state)
            for (double x : r->state->memory()) {
                sum += x;
                most = std::max(most, std::abs(x));
            }
    const bool sound = std::isfinite(sum);
    if (!sound) {
        faults++;
        for (Proxy& p : proxy) {
            std::fill_n(p.force, 3, 0.0);
            std::fill_n(p.slope, 3, 0.0);
            p.owe_nothing();
            std::fill_n(p.brake, 3, 0.0);
            if (p.grip != Grip::idle) p.grip = Grip::refused; // the hand must let go first
        }
        energy = 0;
    }
    home = !sound || (closed == 0 && most < nearly_home);
    if (!home) return;
    now.state->rest();
    if (next.state) next.state->rest();
    energy = 0;
}

void Simulation::push() {
    for (int t = 0; t < most_tools; t++) {
        Felt& f = felt[t];
        const Proxy& p = proxy[t];
        double wanted[3];
        p.total(wanted);
        const double size = length(wanted), way = length(p.displacement);
        const double allowed = std::min({size, settings.limit, length(f.force) + settings.ramp});
        f.touching = p.grip == Grip::holding;
        for (int k = 0; k < 3; k++) f.force[k] = f.touching && size > 0 ? wanted[k] * (allowed / size) : 0;
        std::copy_n(p.tip, 3, f.at);
        std::copy_n(p.at.point, 3, f.anchor);
        std::fill_n(f.normal, 3, 0.0);
        if (f.touching && p.kind == Command::Kind::free) surface.normal(p.at, f.normal);
        f.stiffness = f.touching && way > 1e-3 ? length(p.force) / way : 0;
    }
}

void Simulation::follow_clock(bool on) {
    for (Running* r : {&now, &next})
        if (r->model) on ? r->model->accompany(*r->state) : r->model->leave(*r->state);
}

void Simulation::lack_tables(int wanted) {
    now.state->tables = wanted & 1 ? Tables::without : Tables::at_once;
    if (next.state) next.state->tables = wanted & 2 ? Tables::without : Tables::at_once;
}

uint64_t Simulation::digest() const {
    uint64_t hash = 0x9e3779b97f4a7c15;
    auto mix = [&](double value) {
        uint64_t bits;
        std::memcpy(&bits, &value, sizeof bits);
        hash = (hash ^ bits) * 0xff51afd7ed558ccd;
        hash ^= hash >> 32;
    };
    for (double x : now.state->memory()) mix(x);
    for (const Felt& f : felt)
        for (double x : f.force) mix(x);
    return hash;
}

} // namespace palpate
