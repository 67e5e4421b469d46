#include "haptics/servo.h"
#include "base/vec3.h"
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace palpate {
namespace {

constexpr double forgetting = 0.5; // s, time constant with which energy given out is forgotten in free space
constexpr double quantum = 0.5;    // mm that a position may change in any time: encoders have steps
constexpr double ns = 1e-9;

bool finite(const double* values, int count) {
    return std::all_of(values, values + count, [](double value) { return std::isfinite(value); });
}

void rotate(const double r[9], const double v[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = r[3 * i] * v[0] + r[3 * i + 1] * v[1] + r[3 * i + 2] * v[2];
}
void rotate_back(const double r[9], const double v[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = r[i] * v[0] + r[3 + i] * v[1] + r[6 + i] * v[2];
}

// x = A⁻¹ b by Cholesky; false if A (symmetric) is not positive definite.
bool solve(const double A[9], const double b[3], double x[3]) {
    double l00 = std::sqrt(A[0]), l10 = A[3] / l00, l20 = A[6] / l00;
    double l11 = std::sqrt(A[4] - l10 * l10), l21 = (A[7] - l20 * l10) / l11;
    double l22 = std::sqrt(A[8] - l20 * l20 - l21 * l21);
    if (!(l00 > 0 && l11 > 0 && l22 > 0)) return false;
    double y0 = b[0] / l00, y1 = (b[1] - l10 * y0) / l11, y2 = (b[2] - l20 * y0 - l21 * y1) / l22;
    x[2] = y2 / l22;
    x[1] = (y1 - l21 * x[2]) / l11;
    x[0] = (y0 - l10 * x[1] - l20 * x[2]) / l00;
    return true;
}

// Is this a usable answer? Its stiffness may be indefinite (friction, finite strain), but by less than `margin`.
bool is_usable(const LocalContactModel& answer, double margin) {
    if (!finite(answer.at, 3) || !finite(answer.force, 3) || !finite(answer.stiffness, 9) || !finite(answer.normal, 3))
        return false;
    double A[9], zero[3] = {0, 0, 0}, x[3];
    for (int i = 0; i < 9; i++) A[i] = answer.stiffness[i] + (i % 4 == 0 ? margin : 0);
    return solve(A, zero, x);
}

void check(const ServoSettings& s) {
    const double positive[] = {s.period,       s.force,    s.stiffness, s.damping,   s.max_damping,
                               s.energy_limit, s.scale,    s.max_speed, s.ramp,      s.blend,
                               s.max_age,      s.recovery, s.debounce,  s.withdrawal};
    for (double value : positive)
        if (!(value > 0) || !std::isfinite(value)) throw std::invalid_argument("every servo setting must be above 0");
    if (s.period < 2e-4 || s.period > 2e-3)
        throw std::invalid_argument("period: a device ticks 500 to 5000 times a second");
    if (s.max_age < 3 * s.period) throw std::invalid_argument("max_age: at least three periods");
    if (!finite(s.rotation, 9) || !finite(s.offset, 3))
        throw std::invalid_argument("rotation and offset must be finite");
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double product = 0;
            for (int k = 0; k < 3; k++) product += s.rotation[3 * i + k] * s.rotation[3 * j + k];
            if (std::abs(product - (i == j)) > 1e-6)
                throw std::invalid_argument("rotation: its rows must be orthogonal and of length 1");
        }
    for (int k = 0; k < 3; k++)
        if (!(s.lowest[k] < s.highest[k])) throw std::invalid_argument("lowest must lie below highest");
}

} // namespace

Servo::Servo(const ServoSettings& settings) : settings(settings) { check(settings); }

void Servo::trip(Fault why) {
    if (gone) return;
    if (fault != why) shown.faults++;
    fault = shown.last = why;
    tripped = now;
}

void Servo::lose(Fault why) {
    if (!gone) fault = why;
    if (!gone && why != Fault::off) {
        shown.faults++;
        shown.last = why;
    }
    gone = true;
    shown.gain = shown.damping = 0;
    buttons = 0;
    std::fill_n(last_force, 3, 0.0);
    const double none[3] = {0, 0, 0};
    publish(pose.hand, none);
}

void Servo::restart() {
    gone = read = false;
    fault = Fault::waiting;
    answered = began = 0;
    shown.energy = shown.worst = 0;
}

void Servo::tick(const double position[3], uint8_t bits, int64_t now_ns, double force[3]) {
    double h = begin_tick(now_ns), moved[3] = {0, 0, 0}, hand[3];
    if (plausible(position, h, moved)) {
        observe_energy(moved, h);
        rotate(settings.rotation, position, hand);
        for (int k = 0; k < 3; k++) hand[k] = settings.offset[k] + settings.scale * hand[k];
    } else
        std::copy_n(pose.hand, 3, hand); // the last plausible one
    debounce(bits);
    read_answer();
    update_fault();
    std::fill_n(force, 3, 0.0);
    if (fault == Fault::none) {
        double world[3];
        weight = std::min(1.0, weight + h / settings.blend);
        shown.gain = std::min(1.0, shown.gain + h / settings.ramp);
        solve_coupling(hand, h, world);
        rotate_back(settings.rotation, world, force);
        control_passivity(moved, h, force);
        if (withdrawn) withdraw(h, force);
    }
    if (fault != Fault::none || !finite(force, 3)) { // solve_coupling may refuse the answer
        std::fill_n(force, 3, 0.0);
        std::fill_n(stretch, 3, 0.0);
        shown.gain = shown.damping = 0;
        from = Affine();
        weight = 1;
    }
    std::copy_n(force, 3, last_force);
    publish(hand, force);
}

// Seconds since the last tick, limited to what the coupling can take.
double Servo::begin_tick(int64_t now_ns) {
    double passed = shown.ticks ? double(now_ns - now) * ns : settings.period;
    now = now_ns;
    if (!began) began = now, passed = settings.period;
    shown.ticks++;
    shown.period = passed;
    shown.worst = std::max(shown.worst, passed);
    if (passed > 1.5 * settings.period) shown.late++;
    if (passed > settings.max_age) trip(Fault::late);
    return std::clamp(passed, 0.1 * settings.period, settings.max_age);
}

bool Servo::plausible(const double position[3], double h, double moved[3]) {
    if (gone) return false;
    bool valid = finite(position, 3);
    for (int k = 0; k < 3; k++)
        valid = valid && position[k] >= settings.lowest[k] && position[k] <= settings.highest[k];
    if (!valid) {
        read = false;
        trip(Fault::position);
        return false;
    }
    double step[3];
    for (int k = 0; k < 3; k++) step[k] = position[k] - reading[k];
    bool jumped = read && length(step) > settings.max_speed * h + quantum;
    if (read && !jumped) std::copy_n(step, 3, moved);
    std::copy_n(position, 3, reading);
    read = true;
    if (jumped) trip(Fault::jump);
    return !jumped;
}

void Servo::debounce(uint8_t bits) {
    for (int b = 0; b < 8; b++) {
        uint8_t mask = uint8_t(1u << b);
        if ((bits ^ raw) & mask) still[b] = now;
        if (double(now - still[b]) * ns >= settings.debounce) buttons = uint8_t((buttons & ~mask) | (bits & mask));
    }
    raw = bits;
}

void Servo::read_answer() {
    if (answers.has_new()) {
        const LocalContactModel& answer = answers.latest();
        if (answer.serial == serial) return;
        serial = answer.serial;
        shown.answers++;
        if (!is_usable(answer, settings.stiffness / settings.scale)) {
            trip(Fault::answer);
            answered = 0; // until the next sound one
            return;
        }
        answered = now;
        if (answer.withdrawn && !withdrawn) withdrawn_from = length(last_force);
        withdrawn = answer.withdrawn;
        for (int k = 0; k < 3; k++) from.constant[k] += weight * (to.constant[k] - from.constant[k]);
        for (int k = 0; k < 9; k++) from.stiffness[k] += weight * (to.stiffness[k] - from.stiffness[k]);
        from.touching = (from.touching && weight < 1) || to.touching;
        to = Affine();
        weight = 0;
        if ((to.touching = answer.touching)) {
            rotate(answer.stiffness, answer.at, to.constant);
            for (int k = 0; k < 3; k++) to.constant[k] += answer.force[k];
            std::copy_n(answer.stiffness, 9, to.stiffness);
            std::copy_n(answer.normal, 3, normal);
        }
    }
}

// Which fault holds now, if any. A passing fault is followed by `stalled` if the solver has not answered since.
void Servo::update_fault() {
    if (gone) return;
    const bool recent =
        answered && double(now - answered) * ns + settings.period <= settings.max_age; // held for a period
    const bool settling = fault != Fault::none && fault != Fault::waiting && fault != Fault::stalled;
    if (settling && double(now - tripped) * ns < settings.recovery) return;
    if (!recent) {
        if (answered && fault != Fault::stalled) trip(Fault::stalled);
        return;
    }
    if (fault == Fault::none) return;
    fault = Fault::none;
    from = to; // the force starts from zero: no need to blend
    weight = 1;
    shown.gain = 0;
}

// Passivity observer. The force is constant between ticks, so that its work is exactly force times motion. The energy
// of each contact is counted from zero: what one has dissipated must not allow the next to generate energy.
void Servo::observe_energy(const double moved[3], double h) {
    shown.energy -= dot(last_force, moved);
    bool touching = to.touching || (from.touching && weight < 1);
    if (touching) return;
    shown.energy = shown.energy > 0 ? 0 : shown.energy * std::max(0.0, 1 - h / forgetting);
}

// Virtual coupling. The tool has no mass: stiffness e + damping de/dt + force(hand - e) = 0 with e = hand - tool, by
// implicit Euler.
void Servo::solve_coupling(const double hand[3], double h, double force[3]) {
    const double K = settings.stiffness / settings.scale, B = settings.damping / settings.scale / h;
    double A[9], constant[3], right[3], next[3];
    for (int k = 0; k < 9; k++) A[k] = from.stiffness[k] + weight * (to.stiffness[k] - from.stiffness[k]);
    for (int k = 0; k < 3; k++) constant[k] = from.constant[k] + weight * (to.constant[k] - from.constant[k]);
    rotate(A, hand, right);
    for (int k = 0; k < 3; k++) right[k] += B * stretch[k] - constant[k];
    for (int k = 0; k < 9; k += 4) A[k] += K + B;
    if (!solve(A, right, next)) {
        trip(Fault::answer);
        answered = 0;
        return;
    }
    for (int k = 0; k < 3; k++) force[k] = -K * next[k] - B * (next[k] - stretch[k]);
    double pull = std::min(0.0, dot(force, normal));
    for (int k = 0; k < 3; k++) { // a contact that can only push does not pull: the tool leaves it
        force[k] -= pull * normal[k];
        stretch[k] = (B * stretch[k] - force[k]) / (K + B);
        force[k] *= shown.gain;
    }
}

// Passivity controller in impedance causality: a series damper just strong enough to dissipate in one tick the energy
// given to the hand. It acts a tick late and within bounds, so the force also fades with that energy: whatever the
// solver answers and the hand does, at most 2 energy_limit and the work of one tick are given out.
void Servo::control_passivity(const double moved[3], double h, double force[3]) {
    shown.damping = 0;
    double way = dot(moved, moved);
    if (shown.energy < 0 && way > 0) {
        shown.damping = std::min(-shown.energy * h / way, settings.max_damping);
        for (int k = 0; k < 3; k++) force[k] -= shown.damping / h * moved[k];
    }
    double fade = std::clamp(2 + shown.energy / settings.energy_limit, 0.0, 1.0);
    double most = std::min(1.0, settings.force / std::max(length(force), 1e-12));
    for (int k = 0; k < 3; k++) force[k] *= std::min(fade, most);
}

// The force is no more than that of the tick before, less its part of the time that it has. It returns by the ramp.
void Servo::withdraw(double h, double force[3]) {
    const double most = std::max(0.0, length(last_force) - withdrawn_from * h / settings.withdrawal);
    const double part = std::min(1.0, most / std::max(length(force), 1e-12));
    for (int k = 0; k < 3; k++) force[k] *= part;
    if (most == 0) shown.gain = 0;
}

void Servo::publish(const double hand[3], const double force[3]) {
    pose.serial++;
    pose.buttons = buttons;
    pose.present = read && !gone && fault != Fault::position && fault != Fault::jump;
    std::copy_n(hand, 3, pose.hand);
    for (int k = 0; k < 3; k++) pose.position[k] = hand[k] - stretch[k];
    poses.write_slot() = pose;
    poses.publish();
    shown.fault = fault;
    shown.zeroed = force[0] == 0 && force[1] == 0 && force[2] == 0;
    rotate(settings.rotation, force, shown.force);
    std::copy_n(hand, 3, shown.position);
    status.write_slot() = shown;
    status.publish();
}

const char* fault_name(Fault fault) {
    static const char* const names[] = {"none", "waiting", "stalled", "answer", "position", "jump",
                                        "late", "overrun", "force",   "off",    "lost",     "device"};
    return names[int(fault)];
}

const char* fault_text(Fault fault) {
    static const char* const texts[] = {
        "all is well",
        "the simulation has not answered yet; start it, or wait for its first tick",
        "the simulation did not answer in time, so the force is off; it comes back by itself with the next answer",
        "the simulation's answer was no number or no tissue's stiffness, so the force is off until it is sound again",
        "the device reports a position that is no number or far outside its workspace; check its cable, calibrate it",
        "the device reports a jump that no hand makes; check its cable, calibrate it",
        "the device's callback came too late; close other programs that keep the processor busy",
        "the device's driver says that a tick took too long; close other programs that keep the processor busy",
        "the device refused the force (too much, too fast, or motors too warm); let it rest",
        "the device is not running; start it",
        "the device does not answer any more; plug it in again, switch it on, and start again",
        "the device reports a fault; switch it off and on, and start again"};
    return texts[int(fault)];
}

} // namespace palpate
