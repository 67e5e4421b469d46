#include "multirate/multirate_model.h"
#include "multirate/contact_tracking.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int most = LocalForce::most;
constexpr double velocity_filter = 0.15; // low-pass filter of the tools' velocity, a tick
constexpr double furthest = 0.15;        // of the displacement: how far ahead of a tool a solution is asked for
constexpr double most_scale = 2;
constexpr double slow = 0.05;     // of the stride: a way that counts as none
constexpr int most_latency = 200; // ticks

} // namespace

MultirateState::MultirateState(std::unique_ptr<ModelState> linear, const HyperelasticModel& finite,
                               const std::vector<int>& vertices)
    : linear(std::move(linear)), solver(finite, vertices), pending(solver.blank()), held(pending),
      numbers(5 * most + most * most + 4 + this->linear->state_vector().size(), 0.0) {
    u.assign(3 * size_t(finite.nodes()), 0.0);
}

MultirateState::~MultirateState() = default;

void MultirateState::reset() {
    linear->reset();
    local = LocalForce();
    contacts = fading = 0;
    extra_energy = faded_energy = energy_shift = 0;
    serial++;
    from_rest = true;
    is_pending = false;
    std::fill_n(solved, LocalForce::most, 0.0);
    std::fill(numbers.begin(), numbers.end(), 0.0);
}

MultirateModel::MultirateModel(const ComplianceModel& linear, const HyperelasticModel& finite, int interval,
                               double stride)
    : linear(linear), finite(finite), interval(interval), stride(stride) {}

std::unique_ptr<ModelState> MultirateModel::make_state() const {
    auto state = std::make_unique<MultirateState>(linear.make_state(), finite, linear.stiffness.vertex_node);
    state->owner = this;
    state->latency = interval;
    return state;
}

bool MultirateModel::relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed,
                           double* displacement, int iterations, double* force) const {
    auto& s = static_cast<MultirateState&>(state);
    s.events = 0;
    s.linear->tables = s.tables;
    if (!linear.relax(*s.linear, patches, prescribed, observed, displacement, iterations, force)) return false;
    s.stale = s.linear->stale;
    s.ticks++;
    if (prescribed == 0) {
        if (s.contacts) s.reset();
        s.solution_age = 0, s.solution_error = 0, s.energy_shift = 0;
        return true;
    }
    fade(s, prescribed, displacement);
    follow_contacts(s, prescribed, displacement);
    exchange_solutions(s, patches);
    add_extra_force(s, force);
    s.blending = s.linear->blending;
    s.solution_age = s.local.contacts ? int(s.ticks - s.shown->tick) : 0;
    s.solution_error = s.local.contacts ? s.shown->error : 0;
    write_numbers(s);
    return true;
}

// One tick less: the energy changes, and no tool has worked for that.
void MultirateModel::fade(MultirateState& s, int prescribed, const double* displacement) const {
    s.energy_shift = 0;
    if (s.fading == 0) return;
    s.fading--;
    double energy = s.faded_energy;
    for (int k = 0; k < 3 * std::min(prescribed, s.contacts); k++)
        energy += s.fade[k] * (0.5 * (s.displacement[k] + displacement[k]) - s.fade_from[k]);
    s.energy_shift = -energy / fade_ticks;
}

double MultirateModel::faded_energy(const MultirateState& s) const {
    double energy = s.faded_energy;
    for (int k = 0; k < 3 * s.contacts; k++) energy += s.fade[k] * (s.displacement[k] - s.fade_from[k]);
    return energy * s.fading / fade_ticks;
}

void MultirateModel::follow_contacts(MultirateState& s, int prescribed, const double* displacement) const {
    const int n = 3 * prescribed;
    if (prescribed < s.contacts) { // what the others felt beyond linear forces fades out until a solution comes
        s.local = LocalForce();
        const int gone = prescribed == s.contacts - 1 ? contact_gone(s.displacement, s.contacts, displacement) : 0;
        for (int k = 0; k < n; k++) {
            const int was = k < 3 * gone ? k : k + 3;
            s.fade[k] = s.extra[was];
            s.velocity[k] = s.velocity[was];
            s.solved[k] = s.solved[was];
            s.fade_from[k] = s.displacement[k] = s.displacement[was];
        }
        s.faded_energy = s.extra_energy;
        s.fading = fade_ticks;
    }
    for (int k = 3 * s.contacts; k < n; k++)
        s.displacement[k] = displacement[k], s.velocity[k] = s.fade[k] = s.solved[k] = 0;
    if (prescribed != s.contacts) s.serial++;
    s.contacts = prescribed;
    for (int k = 0; k < n; k++) {
        s.velocity[k] += velocity_filter * (displacement[k] - s.displacement[k] - s.velocity[k]);
        s.displacement[k] = displacement[k];
    }
}

// Takes an answer that is there, and asks for another solution if nothing is under way: by the clock as the thread is
// ready, in lockstep after `interval` ticks, and in a replay as recorded.
void MultirateModel::exchange_solutions(MultirateState& s, const ContactPatch* patches) const {
    const bool replayed = s.recorded_events >= 0;
    const bool comes = replayed   ? s.recorded_events & SolverEvent::taken
                       : s.thread ? s.thread->has_answer()
                                  : s.is_pending && s.ticks - s.sent >= interval;
    if (comes) {
        const EquilibriumAnswer& answer = s.thread ? s.thread->answer() : s.pending;
        if (answer.good && answer.serial == s.serial) {
            if (!s.thread) std::swap(s.held, s.pending);
            take(s, s.thread ? answer : s.held);
        } else if (s.thread) {
            s.shown = &answer; // the thread may write to the one before
        }
        s.is_pending = false;
        s.events |= SolverEvent::taken;
    }
    const bool asks = replayed ? s.recorded_events & SolverEvent::requested
                               : !s.stale && (s.thread ? s.thread->is_free() : !s.is_pending);
    if (!asks) return; // nor while linear tables are missing: they are needed sooner, and take the processor
    write_request(s, patches, s.thread ? s.thread->request() : s.asked);
    if (s.thread) {
        s.thread->send();
    } else {
        s.solver.solve(s.asked, s.pending);
        s.is_pending = true;
    }
    s.events |= SolverEvent::requested;
}

// Requests are for where the tools will be while the answer is in use, but no further from the last one than a solution
// finds with few steps: a hand that is faster is followed by solutions behind it.
void MultirateModel::write_request(MultirateState& s, const ContactPatch* patches, EquilibriumRequest& request) const {
    request.serial = s.serial;
    request.tick = s.ticks;
    request.from_rest = s.from_rest;
    request.contacts = s.contacts;
    const double ahead = 1.5 * s.latency + 0.5 * fade_ticks;
    for (int c = 0; c < s.contacts; c++) {
        request.patch[c].copy(patches[c]);
        double way = 0, size = 0;
        for (int k = 3 * c; k < 3 * c + 3; k++) {
            way += s.velocity[k] * s.velocity[k] * ahead * ahead;
            size += s.displacement[k] * s.displacement[k];
        }
        const double limit = furthest * std::sqrt(size / std::max(way, 1e-30));
        for (int k = 3 * c; k < 3 * c + 3; k++)
            request.displacement[k] = s.displacement[k] + std::min(limit, 1.0) * ahead * s.velocity[k];
    }
    const double* before = s.solved;
    double jump = 0, ahead_most = 0;
    for (int k = 0; k < 3 * s.contacts; k++) {
        jump = std::max(jump, std::abs(request.displacement[k] - before[k]));
        ahead_most = std::max(ahead_most, std::abs(request.displacement[k] - s.displacement[k]));
    }
    request.moving = std::max(jump, ahead_most) > slow * stride;
    for (int c = 0; c < s.contacts; c++) {
        request.moving = request.moving || !same(patches[c], s.last_patch[c]);
        s.last_patch[c].copy(patches[c]);
    }
    if (jump > stride)
        for (int k = 0; k < 3 * s.contacts; k++)
            request.displacement[k] = before[k] + stride / jump * (request.displacement[k] - before[k]);
    std::copy_n(request.displacement, 3 * s.contacts, s.solved);
    s.from_rest = false;
    s.sent = s.ticks;
}

// What finite strain adds is taken to be the same part of the linear force wherever the contacts slide.
double MultirateModel::scale(const MultirateState& s) const {
    const LocalForce& local = s.local;
    if (local.contacts != s.contacts || !(local.linear_work > 0)) return 1;
    const double* K = ComplianceModel::contact_stiffness(static_cast<const ComplianceState&>(*s.linear));
    double work = 0;
    for (int i = 0; i < 3 * s.contacts; i++)
        for (int j = 0; j < 3 * s.contacts; j++)
            work += local.displacement[i] * K[3 * s.contacts * i + j] * local.displacement[j];
    return std::clamp(work / local.linear_work, 1 / most_scale, most_scale);
}

void MultirateModel::take(MultirateState& s, const EquilibriumAnswer& answer) const {
    s.latency = int(std::min<int64_t>(s.ticks - s.sent, most_latency));
    s.faded_energy = faded_energy(s);
    for (double& f : s.fade) f *= double(s.fading) / fade_ticks;
    s.faded_energy += s.local.add_force(s.displacement, s.fade, scale(s));
    s.local = answer.local;
    s.shown = &answer;
    double now[most] = {};
    s.faded_energy -= answer.local.add_force(s.displacement, now, scale(s));
    for (int k = 0; k < most; k++) s.fade[k] -= now[k];
    std::copy_n(s.displacement, most, s.fade_from);
    s.fading = fade_ticks;
}

void MultirateModel::add_extra_force(MultirateState& s, double* force) const {
    for (int k = 0; k < most; k++) s.extra[k] = s.fade[k] * s.fading / fade_ticks;
    s.extra_energy = faded_energy(s) + s.local.add_force(s.displacement, s.extra, scale(s));
    for (int k = 0; k < 3 * s.contacts; k++) force[k] -= s.extra[k];
}

void MultirateModel::write_numbers(MultirateState& s) const {
    const LocalForce& local = s.local;
    double* out = s.numbers.data();
    for (const double* from :
         std::initializer_list<const double*>{s.fade, s.fade_from, s.velocity, local.displacement, local.gradient})
        out = std::copy_n(from, most, out);
    out = std::copy_n(local.curvature, most * most, out);
    for (double x : {double(s.contacts), double(s.fading), s.extra_energy, local.energy}) *out++ = x;
    const std::vector<double>& below = s.linear->state_vector();
    std::copy(below.begin(), below.end(), out);
}

double MultirateModel::energy(const ModelState& state, int prescribed, const double* displacement,
                              const double* force) const {
    const auto& s = static_cast<const MultirateState&>(state);
    double sum = prescribed ? s.extra_energy : 0;
    for (int k = 0; k < 3 * prescribed; k++) sum -= 0.5 * displacement[k] * (force[k] + s.extra[k]);
    return sum;
}

// The newest solution, moved as its tools have moved since.
void MultirateModel::displayed_displacement(ModelState& state, const int* nodes, int count, float* out) const {
    auto& s = static_cast<MultirateState&>(state);
    const EquilibriumAnswer& at = *s.shown;
    if (s.local.contacts == 0) return linear.displayed_displacement(*s.linear, nodes, count, out);
    const std::vector<int>& vertex = linear.stiffness.vertex_index;
    const size_t stride = 3 * size_t(linear.stiffness.vertices());
    for (int i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            double x = at.u[3 * size_t(nodes[i]) + c];
            if (vertex[nodes[i]] >= 0)
                for (int k = 0; k < 3 * at.local.contacts; k++)
                    x += at.response[k * stride + 3 * size_t(vertex[nodes[i]]) + c] *
                         (s.displacement[k] - at.local.displacement[k]);
            out[3 * i + c] = float(x);
        }
}

void MultirateModel::displacement(ModelState& state, double* out) const {
    auto& s = static_cast<MultirateState&>(state);
    if (s.local.contacts == 0) return linear.displacement(*s.linear, out);
    std::copy(s.shown->u.begin(), s.shown->u.end(), out);
}

void MultirateModel::prefetch(ModelState& state, const ContactPatch* patches, int count) const {
    linear.prefetch(*static_cast<MultirateState&>(state).linear, patches, count);
}

void MultirateModel::begin_realtime(ModelState& state) const {
    auto& s = static_cast<MultirateState&>(state);
    linear.begin_realtime(*s.linear);
    s.tables = TablePolicy::background;
    s.recorded_events = -1;
    s.is_pending = false;
    s.thread = std::make_unique<MultirateState::Thread>(s.solver, s.solver.blank());
}

void MultirateModel::end_realtime(ModelState& state) const {
    auto& s = static_cast<MultirateState&>(state);
    if (s.shown != &s.held) s.held = *s.shown;
    s.shown = &s.held;
    s.thread.reset();
    linear.end_realtime(*s.linear);
    s.tables = TablePolicy::on_demand;
}

} // namespace palpate
