#include "multirate/linear_multirate_model.h"
#include "linalg/small_dense.h"
#include "multirate/contact_tracking.h"
#include "tissue/stiffness_blend.h"

namespace palpate {
namespace {

using State = LinearMultirateState;
constexpr int most_unknowns = State::most;
constexpr int most_repeats = 16; // of a request for patches that stay; more iterations would change nothing

// The stiffness of the other contacts when one is free: K_aa - K_ab K_bb^-1 K_ba. K: (n, n), becomes (n - 3, n - 3).
void release(double* K, int n, int gone) {
    double part[9], inverse[9] = {}, out[most_unknowns * most_unknowns];
    for (int k = 0; k < 9; k++) part[k] = K[n * (3 * gone + k / 3) + 3 * gone + k % 3];
    if (!invert_positive(part, 3, inverse)) std::fill_n(inverse, 9, 0.0); // its stiffness was not known yet
    const auto at = [&](int k) { return k < 3 * gone ? k : k + 3; };
    for (int i = 0; i < n - 3; i++)
        for (int j = 0; j < n - 3; j++) {
            double sum = K[n * at(i) + at(j)];
            for (int k = 0; k < 9; k++)
                sum -= K[n * at(i) + 3 * gone + k / 3] * inverse[k] * K[n * (3 * gone + k % 3) + at(j)];
            out[(n - 3) * i + j] = sum;
        }
    std::copy_n(out, (n - 3) * (n - 3), K);
}

bool refused(const State& s) { return s.newest->serial == s.serial && !s.newest->good; }

// A contact more: without stiffness until that is known.
void admit(double* K, int n) {
    double out[most_unknowns * most_unknowns] = {};
    for (int i = 0; i < n; i++) std::copy_n(K + n * i, n, out + (n + 3) * i);
    std::copy_n(out, (n + 3) * (n + 3), K);
}

} // namespace

void LinearMultirateState::reset() {
    values.assign(size, 0.0);
    serial++;
    repeats = 0;
}

std::unique_ptr<ModelState> LinearMultirateModel::make_state() const {
    auto state = std::make_unique<State>(model);
    state->u.assign(3 * size_t(nodes()), 0);
    state->owner = this;
    return state;
}

bool LinearMultirateModel::relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed,
                                 double* displacement, int, double* force) const {
    auto& s = static_cast<State&>(state);
    s.events = s.refused_events; // of this tick's first call, which was refused
    s.refused_events = 0;
    s.ticks++;
    if (prescribed == 0) {
        if (s.values[State::contacts_at] > 0) s.reset();
        s.stale = s.blending = false;
    } else {
        follow_contacts(s, prescribed, displacement);
        exchange_solutions(s, patches);
        if (refused(s)) {
            s.refused_events = s.events;
            return false;
        }
        const int n = 3 * prescribed;
        double *K = &s.values[State::stiffness_at], *offset = &s.values[State::offset_at];
        s.stale = !s.known();
        s.blending = s.stale || StiffnessBlend::advance(K, offset, s.newest->stiffness, n, displacement);
        for (int i = 0; i < n; i++) {
            force[i] = 0;
            for (int j = 0; j < n; j++) force[i] -= K[n * i + j] * displacement[j];
        }
        std::copy_n(displacement, n, &s.values[State::displacement_at]);
    }
    observe(s, patches, prescribed, observed, displacement, force);
    return true;
}

void LinearMultirateModel::follow_contacts(State& s, int prescribed, const double* displacement) const {
    const int before = int(s.values[State::contacts_at]);
    if (before == prescribed) return;
    double* K = &s.values[State::stiffness_at];
    for (int now = before; now < prescribed; now++) admit(K, 3 * now);
    for (int now = before; now > prescribed; now--) {
        double* d = &s.values[State::displacement_at];
        const int gone = now == prescribed + 1 ? contact_gone(d, now, displacement) : now - 1;
        release(K, 3 * now, gone);
    }
    s.values[State::contacts_at] = prescribed;
    s.serial++;
    s.repeats = 0;
}

// Takes an answer that is there, and asks for another one if nothing is under way: by the clock as the thread is ready,
// in lockstep after `interval` ticks, and in a replay as recorded.
void LinearMultirateModel::exchange_solutions(State& s, const ContactPatch* patches) const {
    enum Event { requested = 1, taken = 2 }; // ModelState::events
    const int contacts = int(s.values[State::contacts_at]);
    const bool replayed = s.recorded_events >= 0;
    const int recorded = s.recorded_events & ~s.events;
    const bool comes = replayed   ? recorded & taken
                       : s.thread ? s.thread->has_answer()
                                  : s.is_pending && s.ticks - s.sent >= interval;
    if (comes) {
        if (!s.thread) std::swap(s.held, s.pending);
        s.newest = s.thread ? &s.thread->answer() : &s.held;
        if (s.known())
            for (int k = 0; k < 9 * contacts * contacts; k++)
                s.values[State::offset_at + k] = s.values[State::stiffness_at + k] - s.newest->stiffness[k];
        s.is_pending = false;
        s.events |= taken;
        if (refused(s)) return;
    }
    for (int c = 0; c < contacts; c++)
        if (!same(patches[c], s.last_patch[c])) s.repeats = 0;
    const bool free = s.thread ? s.thread->is_free() : !s.is_pending;
    if (!(replayed ? recorded & requested : free && s.repeats < most_repeats)) return;
    StiffnessRequest& request = s.thread ? s.thread->request() : s.asked;
    request.serial = s.serial;
    request.contacts = contacts;
    for (int c = 0; c < contacts; c++) request.patch[c].copy(patches[c]), s.last_patch[c].copy(patches[c]);
    if (s.thread) {
        s.thread->send();
    } else {
        s.solver.solve(s.asked, s.pending);
        s.is_pending = true;
    }
    s.repeats++;
    s.sent = s.ticks;
    s.events |= requested;
}

// By the newest solution's columns; while there is none, what they were.
void LinearMultirateModel::observe(State& s, const ContactPatch* patches, int prescribed, int observed,
                                   double* displacement, double* force) const {
    const size_t stride = 3 * size_t(nodes());
    for (int o = prescribed; o < prescribed + observed; o++) {
        double* mean = &s.values[State::observed_at + 3 * o];
        if (prescribed == 0 || s.known()) std::fill_n(mean, 3, 0.0);
        for (int k = 0; k < 3 * prescribed && s.known(); k++)
            for (int i = 0; i < patches[o].count; i++)
                for (int c = 0; c < 3; c++)
                    mean[c] += displacement[k] * patches[o].weight[i] *
                               double(s.newest->u[k * stride + 3 * size_t(patches[o].node[i]) + c]);
        std::copy_n(mean, 3, displacement + 3 * o);
        std::fill_n(force + 3 * o, 3, 0.0);
    }
}

void LinearMultirateModel::displayed_displacement(ModelState& state, const int* nodes, int count, float* out) const {
    auto& s = static_cast<State&>(state);
    const size_t stride = 3 * size_t(this->nodes());
    const int n = s.known() ? 3 * int(s.values[State::contacts_at]) : 0;
    std::fill_n(out, 3 * size_t(count), 0.0f);
    for (int k = 0; k < n; k++) {
        const float d = float(s.values[State::displacement_at + k]), *u = &s.newest->u[k * stride];
        for (int i = 0; i < count; i++)
            for (int c = 0; c < 3; c++) out[3 * size_t(i) + c] += d * u[3 * size_t(nodes[i]) + c];
    }
}

void LinearMultirateModel::displacement(ModelState& state, double* out) const {
    auto& s = static_cast<State&>(state);
    const size_t stride = 3 * size_t(nodes());
    const int n = s.known() ? 3 * int(s.values[State::contacts_at]) : 0;
    std::fill_n(out, stride, 0.0);
    for (int k = 0; k < n; k++)
        for (size_t i = 0; i < stride; i++)
            out[i] += s.values[State::displacement_at + k] * double(s.newest->u[k * stride + i]);
}

void LinearMultirateModel::begin_realtime(ModelState& state) const {
    auto& s = static_cast<State&>(state);
    s.tables = TablePolicy::background;
    s.recorded_events = -1;
    s.is_pending = false;
    s.solver.reset();
    s.thread = std::make_unique<State::Thread>(s.solver, s.solver.blank());
}

void LinearMultirateModel::end_realtime(ModelState& state) const {
    auto& s = static_cast<State&>(state);
    if (s.newest != &s.held) s.held = *s.newest;
    s.newest = &s.held;
    s.thread.reset();
    s.tables = TablePolicy::on_demand;
}

} // namespace palpate
