#include "multirate/linear_multirate_model.h"
#include "base/vec3.h"
#include "linalg/small_dense.h"
#include "multirate/contact_tracking.h"
#include "tissue/stiffness_blend.h"
#include <cmath>

namespace palpate {
namespace {

using State = LinearMultirateState;
constexpr int most_unknowns = State::most;
constexpr double home[3] = {0, 0, 0};
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

// The stiffness that gives the force of now from the whole displacement, and its difference to the newest solution's.
void rebase(State& s, const double* displacement) {
    const int n = 3 * int(s.values[State::contacts_at]);
    double *K = &s.values[State::stiffness_at], *origin = &s.values[State::origin_at], square = 0;
    for (int k = 0; k < n; k++) square += displacement[k] * displacement[k];
    for (int i = 0; i < n && square > 0; i++) {
        double held = 0; // force that the origins take away
        for (int j = 0; j < n; j++) held += K[n * i + j] * origin[j];
        for (int j = 0; j < n; j++) K[n * i + j] -= held * displacement[j] / square;
    }
    std::fill_n(origin, n, 0.0);
    for (int k = 0; k < n * n; k++) s.values[State::offset_at + k] = K[k] - s.newest->stiffness[k];
}

bool refused(const State& s) { return s.newest->serial == s.serial && !s.newest->good; }

// A contact more, of stiffness `guess` alone.
void admit(double* K, int n, double guess) {
    double out[most_unknowns * most_unknowns] = {};
    for (int i = 0; i < n; i++) std::copy_n(K + n * i, n, out + (n + 3) * i);
    for (int i = n; i < n + 3; i++) out[(n + 3) * i + i] = guess;
    std::copy_n(out, (n + 3) * (n + 3), K);
}

} // namespace

LinearMultirateModel::LinearMultirateModel(const MultigridModel& model, int interval, std::vector<double> position,
                                           std::vector<double> shear, const std::vector<ContactPatch>& samples)
    : model(model), interval(interval), position(std::move(position)), shear(std::move(shear)) {
    ContactStiffnessSolver solver(model);
    StiffnessAnswer answer = solver.blank();
    StiffnessRequest request;
    request.contacts = 1;
    for (const ContactPatch& patch : samples) {
        request.serial++;
        request.patch[0].copy(patch);
        solver.solve(request, answer);
        for (int i = 0; i < 3 && answer.good; i++) {
            double row = 0; // the largest of these sums is no less than the largest eigenvalue
            for (int j = 0; j < 3; j++) row += std::abs(answer.stiffness[3 * i + j]);
            most_stiff = std::max(most_stiff, row / scale_of(patch));
        }
    }
}

// A density (1 - rho^2)^2 over a disc has half its radius as root mean square.
double LinearMultirateModel::scale_of(const ContactPatch& patch) const {
    double middle[3], square = 0, modulus = 0;
    patch.mean(position.data(), middle);
    for (int i = 0; i < patch.count; i++) {
        square += patch.weight[i] * square_of_distance(&position[3 * size_t(patch.node[i])], middle);
        modulus += patch.weight[i] * shear[patch.node[i]];
    }
    return modulus * 2 * std::sqrt(square);
}

void LinearMultirateState::reset() {
    values.assign(size, 0.0);
    shown_contacts = 0;
    serial++;
    repeats = 0;
}

std::unique_ptr<ModelState> LinearMultirateModel::make_state() const {
    auto state = std::make_unique<State>(model);
    state->u.assign(3 * size_t(nodes()), 0);
    state->lags = true;
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
        s.stale = false;
    } else {
        follow_contacts(s, patches, prescribed, displacement);
        exchange_solutions(s, patches, displacement);
        if (refused(s)) {
            s.refused_events = s.events;
            return false;
        }
        const int n = 3 * prescribed;
        double *K = &s.values[State::stiffness_at], *offset = &s.values[State::offset_at];
        const double* origin = &s.values[State::origin_at];
        s.stale = !s.known();
        if (!s.stale) std::copy_n(displacement, n, s.shown), s.shown_contacts = prescribed;
        if (!s.stale) StiffnessBlend::advance(K, offset, s.newest->stiffness, n, displacement);
        for (int i = 0; i < n; i++) {
            force[i] = 0;
            for (int j = 0; j < n; j++) force[i] -= K[n * i + j] * (displacement[j] - origin[j]);
        }
        std::copy_n(displacement, n, &s.values[State::displacement_at]);
    }
    observe(s, patches, prescribed, observed, displacement, force);
    return true;
}

// A new contact is taken to be as stiff as the stiffest sample, until its own stiffness is known: one that grew in a
// tissue that has been displaced would give energy away, one that falls does not. Beside others it lands where these
// have taken the tissue, without a force.
void LinearMultirateModel::follow_contacts(State& s, const ContactPatch* patches, int prescribed,
                                           const double* displacement) const {
    const int before = int(s.values[State::contacts_at]);
    if (before == prescribed) return;
    double* K = &s.values[State::stiffness_at];
    double *d = &s.values[State::displacement_at], *origin = &s.values[State::origin_at];
    for (int now = before; now < prescribed; now++) {
        admit(K, 3 * now, most_stiff * scale_of(patches[now]));
        std::copy_n(before > 0 ? displacement + 3 * now : home, 3, origin + 3 * now);
    }
    for (int now = before; now > prescribed; now--) {
        const int gone = now == prescribed + 1 ? contact_gone(d, now, displacement) : now - 1;
        release(K, 3 * now, gone);
        for (double* list : {d, origin}) std::copy(list + 3 * gone + 3, list + 3 * now, list + 3 * gone);
    }
    s.values[State::contacts_at] = prescribed;
    s.serial++;
    s.repeats = 0;
}

// Takes an answer that is there, and asks for another one if nothing is under way: by the clock as the thread is ready,
// in lockstep after `interval` ticks, and in a replay as recorded.
void LinearMultirateModel::exchange_solutions(State& s, const ContactPatch* patches, const double* displacement) const {
    const int contacts = int(s.values[State::contacts_at]);
    const bool replayed = s.recorded_events >= 0;
    const int recorded = s.recorded_events & ~s.events;
    const bool comes = replayed   ? recorded & SolverEvent::taken
                       : s.thread ? s.thread->has_answer()
                                  : s.is_pending && s.ticks - s.sent >= interval;
    if (comes) {
        if (!s.thread) std::swap(s.held, s.pending);
        s.newest = s.thread ? &s.thread->answer() : &s.held;
        if (s.known()) rebase(s, displacement);
        s.is_pending = false;
        s.events |= SolverEvent::taken;
        if (refused(s)) return;
    }
    for (int c = 0; c < contacts; c++)
        if (!same(patches[c], s.last_patch[c])) s.repeats = 0;
    const bool free = s.thread ? s.thread->is_free() : !s.is_pending;
    if (!(replayed ? recorded & SolverEvent::requested : free && s.repeats < most_repeats)) return;
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
    s.events |= SolverEvent::requested;
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

// Where contacts have closed or opened since the newest solution, the field stays as it was until the next one.
void LinearMultirateModel::displayed_displacement(ModelState& state, const int* nodes, int count, float* out) const {
    auto& s = static_cast<State&>(state);
    const size_t stride = 3 * size_t(this->nodes());
    std::fill_n(out, 3 * size_t(count), 0.0f);
    for (int k = 0; k < s.shown_unknowns(); k++) {
        const float d = float(s.shown[k]), *u = &s.newest->u[k * stride];
        for (int i = 0; i < count; i++)
            for (int c = 0; c < 3; c++) out[3 * size_t(i) + c] += d * u[3 * size_t(nodes[i]) + c];
    }
}

void LinearMultirateModel::displacement(ModelState& state, double* out) const {
    auto& s = static_cast<State&>(state);
    const size_t stride = 3 * size_t(nodes());
    std::fill_n(out, stride, 0.0);
    for (int k = 0; k < s.shown_unknowns(); k++)
        for (size_t i = 0; i < stride; i++) out[i] += s.shown[k] * double(s.newest->u[k * stride + i]);
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
