#include "simulation/simulation.h"
#include "base/vec3.h"
#include <algorithm>
#include <cmath>
#include <cstring>

namespace palpate {
namespace {

constexpr double rest_tolerance = 1e-6; // mm, largest displacement of a tissue that counts as at rest
constexpr double taken_away = 0.1;      // mm from a contact to the surface after a cut, from which on its place is gone

} // namespace

Simulation::Simulation(const TissueModel& model, const ContactSurface& surface, const SimulationSettings& settings,
                       std::vector<int> shown)
    : settings(settings),
      now{&model, model.make_state(), settings.sweeps, &surface, surface.scratch(), std::move(shown), {}} {}

void Simulation::tick(const Commands& commands) {
    const bool known = !now.state->stale;
    for (int t = 0; t < most_tools; t++) {
        if (now.loose.update(proxy, t, commands.tool[t], settings.tools.motion)) continue;
        bool others = !at_rest;
        for (int o = 0; o < most_tools; o++) others = others || (o != t && proxy[o].state == ContactState::closed);
        const bool was_closed = proxy[t].state == ContactState::closed;
        update_proxy(proxy[t], commands.tool[t], *now.surface, settings.tools, others && !was_closed, known,
                     now.scratch);
        if (!was_closed && proxy[t].state == ContactState::closed) proxy[t].contact_tick = ticks;
    }
    gather_contacts();
    now.loose.advance(proxy, ticks);
    if (closed > 0 || !at_rest) {
        while (!solve_contacts()) { // the contact that came last cannot be held with the others
            proxy[tool_of[closed - 1]].state = ContactState::refused;
            gather_contacts();
        }
        estimate_energy_slopes();
        observe_energy();
        check_answers();
    } else {
        for (int c = 0; c < open; c++) std::fill_n(proxy[tool_of[c]].displacement, 3, 0.0);
        observe_energy();
    }
    write_feedback();
    ticks++;
}

// A held tool approaches its command over several ticks, so that the present command predicts the next tick; a tool in
// space is where its command is, so that its motion is extrapolated.
void Simulation::look_ahead(const Commands& commands) {
    int count = 0;
    bool any = false;
    for (int t = 0; t < most_tools; t++) {
        const Command &now = commands.tool[t], &then = previous_commands.tool[t];
        if (proxy[t].state != ContactState::closed && proxy[t].state != ContactState::open) continue;
        Command next = now;
        if (now.kind == CommandKind::free && then.kind == CommandKind::free)
            for (int k = 0; k < 3; k++) next.point[k] += now.point[k] - then.point[k];
        predicted[t] = proxy[t];
        update_proxy(predicted[t], next, *this->now.surface, settings.tools, false, !this->now.state->stale,
                     this->now.scratch);
        if (predicted[t].state != ContactState::closed && predicted[t].state != ContactState::open) continue;
        any = any || predicted[t].state == ContactState::closed;
        patch[count++].copy(predicted[t].patch);
    }
    previous_commands = commands;
    if (!any) return;
    now.model->prefetch(*now.state, patch, count);
    if (next.model) next.model->prefetch(*next.state, patch, count);
}

void Simulation::gather_contacts() {
    closed = open = 0;
    for (int t = 0; t < most_tools; t++) {
        if (proxy[t].state != ContactState::closed) continue;
        int at = closed++;
        for (; at > 0 && proxy[tool_of[at - 1]].contact_tick > proxy[t].contact_tick; at--)
            tool_of[at] = tool_of[at - 1];
        tool_of[at] = t;
    }
    for (int t = 0; t < most_tools; t++)
        if (proxy[t].state == ContactState::open) tool_of[closed + open++] = t;
    for (int c = 0; c < closed + open; c++) {
        const ToolProxy& p = proxy[tool_of[c]];
        patch[c].copy(p.patch);
        std::copy_n(p.displacement, 3, displaced + 3 * c);
        std::fill_n(force + 3 * c, 3, 0.0);
    }
}

bool Simulation::solve_contacts() {
    if (!now.model->relax(*now.state, patch, closed, open, displaced, now.sweeps, force)) {
        if (closed > 1) return false;
        if (closed == 1) proxy[tool_of[0]].state = ContactState::refused; // not even alone
        gather_contacts();
        std::fill_n(force, 3 * most_tools, 0.0);
    }
    missing_tables = now.state->stale | now.state->events << 2;
    if (next.model) blend_models();
    for (ToolProxy& p : proxy)
        if (p.state != ContactState::cutting && p.state != ContactState::carrying) std::fill_n(p.force, 3, 0.0);
    for (int c = 0; c < closed + open; c++) {
        ToolProxy& p = proxy[tool_of[c]];
        std::copy_n(force + 3 * c, 3, p.force);
        if (c < closed && p.kind == CommandKind::free) separate_if_pulled(p);
        if (c < closed) continue;
        std::copy_n(displaced + 3 * c, 3, p.displacement);
        p.released = false;
    }
    return true;
}

// A tool in space does not adhere: its contact opens where the tissue would pull it.
void Simulation::separate_if_pulled(ToolProxy& p) const {
    double out[3];
    now.surface->normal(p.at, out);
    if (dot(p.force, out) >= 0) return;
    p.state = ContactState::open;
    p.released = true;
    std::fill_n(p.force, 3, 0.0);
    std::fill_n(p.slope, 3, 0.0);
}

// The new model runs beside the present one: first its force is unused, then its share grows from 0 to 1.
void Simulation::blend_models() {
    double same[3 * most_tools];
    std::copy_n(displaced, 3 * most_tools, same);
    const bool good = next.model->relax(*next.state, patch, closed, open, same, next.sweeps, next_force);
    missing_tables |= next.state->stale << 1 | next.state->events << 4;
    since++;
    const double share = std::clamp(double(since - settle) / blend, 0.0, 1.0);
    if (good)
        for (int k = 0; k < 3 * closed; k++) force[k] += share * (next_force[k] - force[k]);
    if (since < settle + blend) return;
    next.surface = now.surface;
    std::swap(next.scratch, now.scratch);
    std::swap(next.shown, now.shown);
    std::swap(next.loose, now.loose);
    old = std::move(now);
    now = std::move(next);
    next = ActiveModel();
}

void Simulation::change(ActiveModel to) {
    next = std::move(to), since = 0;
    if (next.surface) change_body();
}

// Tools that touch the body before stay where they are on its surface, and go on from the force that they felt. What
// held a piece that has come free carries it; what pressed there has nothing under it any more.
void Simulation::change_body() {
    old = std::move(now);
    now = std::move(next);
    next = ActiveModel();
    bodies++;
    now.model->continue_from(*now.state, *old.state);
    now.loose.go_on_from(old.loose, proxy, ticks);
    for (int t = 0; t < most_tools; t++) {
        ToolProxy& p = proxy[t];
        const bool elsewhere = p.state == ContactState::idle || p.state == ContactState::refused;
        if (elsewhere || p.state == ContactState::carrying) continue;
        const SurfacePoint at = now.surface->closest(p.at.point);
        const bool holds = p.state == ContactState::closed && p.kind == CommandKind::hold;
        if (at.distance > taken_away && holds && !presses(p, *old.surface) && now.loose.take_over(proxy, t, taken_away))
            continue;
        p.at = at;
        if (p.at.distance > taken_away) {
            p.clear_forces();
            p.state = ContactState::refused; // until the tool is taken away
        } else if (p.state != ContactState::cutting)
            find_patch(p, *now.surface, settings.tools, now.scratch);
    }
}

// Whether a tool pushes the tissue in, and not along the surface or out: within 60 degrees of its inward normal.
bool Simulation::presses(const ToolProxy& p, const ContactSurface& on) const {
    double out[3];
    on.normal(p.at, out);
    return dot(p.displacement, out) < -0.5 * length(p.displacement);
}

void Simulation::check_answers() {
    double sum = 0, most = 0;
    for (int k = 0; k < 3 * closed; k++) sum += force[k];
    for (const ActiveModel* active : {&now, &next})
        if (active->state)
            for (double x : active->state->state_vector()) {
                sum += x;
                most = std::max(most, std::abs(x));
            }
    const bool finite = std::isfinite(sum);
    if (!finite) {
        faults++;
        for (ToolProxy& p : proxy) {
            p.clear_forces();
            if (p.state != ContactState::idle) p.state = ContactState::refused; // until the tool is taken away
        }
        energy = 0;
    }
    at_rest = !finite || (closed == 0 && most < rest_tolerance);
    if (!at_rest) return;
    now.state->reset();
    if (next.state) next.state->reset();
    energy = 0;
}

void Simulation::write_feedback() {
    for (int t = 0; t < most_tools; t++) {
        Feedback& f = feedback[t];
        const ToolProxy& p = proxy[t];
        double wanted[3];
        p.total_force(wanted);
        const double size = length(wanted), way = length(p.displacement);
        const double allowed = std::min({size, settings.limit, length(f.force) + settings.ramp});
        const bool carries = p.state == ContactState::carrying;
        f.touching = p.state == ContactState::closed || p.state == ContactState::cutting || carries;
        for (int k = 0; k < 3; k++) f.force[k] = f.touching && size > 0 ? wanted[k] * (allowed / size) : 0;
        std::copy_n(p.tip, 3, f.at);
        std::copy_n(p.at.point, 3, f.anchor);
        std::fill_n(f.out, 3, 0.0), std::fill_n(f.normal, 3, 0.0);
        if (f.touching && !carries) now.surface->normal(p.at, f.out);
        if (f.touching && p.kind == CommandKind::free) std::copy_n(f.out, 3, f.normal);
        f.stiffness = f.touching && !carries && way > 1e-3 ? length(p.force) / way : 0;
        if (p.state == ContactState::cutting && length(p.force) > 0.999 * p.resistance)
            f.stiffness = 0; // the cut gives way
    }
    for (int c = 0; c < closed; c++) {
        const double *d = proxy[tool_of[c]].displacement, square = dot(d, d);
        double slope[9], along = 0;
        if (feedback[tool_of[c]].stiffness == 0 || !now.model->contact_slope(*now.state, c, slope)) continue;
        for (int k = 0; k < 9; k++) along += d[k / 3] * slope[k] * d[k % 3];
        feedback[tool_of[c]].stiffness = along / square;
    }
}

void Simulation::follow_clock(bool on) {
    for (ActiveModel* active : {&now, &next})
        if (active->model)
            on ? active->model->begin_realtime(*active->state) : active->model->end_realtime(*active->state);
}

void Simulation::set_missing_tables(int wanted) {
    int bit = 0;
    for (ActiveModel* active : {&now, &next}) {
        if (active->state) {
            active->state->tables = wanted >> bit & 1 ? TablePolicy::unavailable : TablePolicy::on_demand;
            active->state->recorded_events = wanted & TableEvent::recorded ? wanted >> (2 + 2 * bit) & 3 : -1;
        }
        bit++;
    }
}

uint64_t Simulation::digest() const {
    uint64_t hash = 0x9e3779b97f4a7c15;
    auto mix = [&](double value) {
        uint64_t bits;
        std::memcpy(&bits, &value, sizeof bits);
        hash = (hash ^ bits) * 0xff51afd7ed558ccd;
        hash ^= hash >> 32;
    };
    for (double x : now.state->state_vector()) mix(x);
    for (const Feedback& f : feedback)
        for (double x : f.force) mix(x);
    for (const LoosePiece& p : pieces()) {
        for (double x : p.offset) mix(x);
        mix(double(p.state));
    }
    return hash;
}

} // namespace palpate
