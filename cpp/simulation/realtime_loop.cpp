#include "simulation/realtime_loop.h"
#include "realtime/periodic_timer.h"
#include "simulation/replay.h"
#include <algorithm>
#include <chrono>
#include <ctime>
#include <stdexcept>

namespace palpate {
namespace {

using clock = std::chrono::steady_clock;

constexpr size_t room_for_cuts = 3; // times the nodes shown at first

constexpr auto look_ahead_time = std::chrono::microseconds(200); // least rest of a period for look_ahead

std::chrono::nanoseconds thread_time() { // processor time of this thread
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return std::chrono::seconds(t.tv_sec) + std::chrono::nanoseconds(t.tv_nsec);
}

bool same(const Command& a, const Command& b) {
    if (a.kind != b.kind) return false;
    for (int k = 0; k < 3; k++)
        if (a.point[k] != b.point[k] || a.displacement[k] != b.displacement[k]) return false;
    return true;
}

Frame blank(size_t shown) {
    Frame frame;
    frame.shown.resize(3 * shown);
    return frame;
}

} // namespace

double sweep_seconds(const TissueModel& model, const ContactSurface& surface, double radius) {
    constexpr int sweeps = 4, tries = 15;
    auto state = model.make_state();
    auto scratch = surface.scratch();
    ContactPatch patch;
    for (int t = 0; t < surface.triangles(); t++) {
        SurfacePoint at;
        at.triangle = t;
        at.weight[0] = 1;
        std::copy_n(&surface.position[3 * surface.corner[3 * t]], 3, at.point);
        if (surface.patch(at, radius, scratch, patch) == ContactSurface::PatchStatus::good) break;
    }
    double force[3], best = 1;
    for (int i = 0; i < tries; i++) { // deeper each time: a model that has converged would seem too fast
        double push[3] = {0, 0, -1 - 0.1 * i};
        auto began = clock::now();
        model.relax(*state, &patch, 1, 0, push, sweeps, force);
        best = std::min(best, seconds(clock::now() - began) / sweeps);
    }
    return best;
}

RealtimeLoop::RealtimeLoop(const TissueModel& model, const ContactSurface& surface, const SimulationSettings& settings,
                           std::vector<int> shown)
    : shown_room(shown.size() * room_for_cuts + 1000), frames(blank(shown_room)), command_events(1 << 16),
      digests(1 << 16), changes(1 << 8), table_events(1 << 16), simulation(model, surface, settings, std::move(shown)) {
}

RealtimeLoop::~RealtimeLoop() {
    stop();
    free_retired();
    delete requested.load();
    delete changing;
}

void RealtimeLoop::start(Device& device) {
    if (thread.joinable()) throw std::logic_error("the loop runs already");
    stopping = false;
    if (ActiveModel* to = requested.load()) to->model->begin_realtime(*to->state);
    thread = std::thread([this, &device] { run(device); });
}

void RealtimeLoop::stop() {
    if (!thread.joinable()) return;
    stopping = true;
    thread.join();
    if (ActiveModel* to = requested.load()) to->model->end_realtime(*to->state);
}

void RealtimeLoop::run(Device& device) {
    simulation.follow_clock(true);
    const auto began = clock::now();
    PeriodicTimer beat(rate);
    const int64_t kept_late = late; // of earlier runs
    while (!stopping.load(std::memory_order_relaxed)) {
        const auto behind = beat.lateness();
        const auto started = clock::now();
        const auto before = thread_time();
        tick(device, true);
        processor_time.add(thread_time() - before);
        const auto done = clock::now();
        tick_time.add(done - started), wake_latency.add(behind);
        busy += 0.01 * (seconds(done - started) - busy);
        if (simulation.ticks - published >= (last.serial != answered ? answer_ticks : frame_ticks))
            publish(seconds(done - began));
        if (beat.remaining() > look_ahead_time) simulation.look_ahead(last); // no answer waits for it
        beat.wait();
        late = kept_late + beat.missed;
    }
    Replay no_tools({}, {}, {});
    tick(no_tools, true); // takes the tools away, so that the device is left without force
    device.write_feedback(simulation.feedback);
    simulation.follow_clock(false);
    publish(seconds(clock::now() - began));
}

void RealtimeLoop::tick(Device& device, bool by_clock) {
    const Commands& commands = device.read_commands(simulation.ticks);
    for (int t = 0; t < most_tools; t++)
        if (!same(commands.tool[t], last.tool[t])) command_events.push({simulation.ticks, t, commands.tool[t]});
    last = commands;
    accept_change();
    if (!by_clock)
        simulation.set_missing_tables(device.missing_tables(simulation.ticks)); // also of a model accepted in this tick
    simulation.tick(commands);
    if (simulation.missing_tables != missing_tables)
        table_events.push({simulation.ticks - 1, simulation.missing_tables});
    missing_tables = simulation.missing_tables;
    device.write_feedback(simulation.feedback);
    if (simulation.ticks % digest_ticks == 0) digests.push({simulation.ticks, simulation.digest()});
}

void RealtimeLoop::accept_change() {
    if (simulation.changing()) return;
    if (changing) {
        *changing = simulation.retired();
        retired.store(changing, std::memory_order_release);
        changing = nullptr;
    } else if (ActiveModel* to = requested.exchange(nullptr, std::memory_order_acq_rel)) {
        changes.push(simulation.ticks);
        changing = to; // will hold the retired model
        simulation.change(std::move(*to));
    }
}

bool RealtimeLoop::change(const TissueModel& model, int sweeps) {
    return request({&model, model.make_state(), sweeps, nullptr, {}, {}, {}});
}

bool RealtimeLoop::change_body(const TissueModel& model, const ContactSurface& surface, int sweeps,
                               std::vector<int> shown, LoosePieces loose) {
    return request(
        {&model, model.make_state(), sweeps, &surface, surface.scratch(), std::move(shown), std::move(loose)});
}

bool RealtimeLoop::change_pending() {
    free_retired();
    return requested.load() || pending;
}

bool RealtimeLoop::request(ActiveModel wanted) {
    if (change_pending()) return false;
    auto* to = new ActiveModel(std::move(wanted));
    if (running()) to->model->begin_realtime(*to->state);
    pending = true;
    requested.store(to, std::memory_order_release);
    return true;
}

void RealtimeLoop::free_retired() {
    ActiveModel* left = retired.exchange(nullptr, std::memory_order_acq_rel);
    if (!left) return;
    if (left->model) left->model->end_realtime(*left->state);
    delete left;
    pending = false;
}

void RealtimeLoop::publish(double now) {
    Frame& frame = frames.write_slot();
    frame.tick = simulation.ticks;
    frame.late = late;
    frame.faults = simulation.faults;
    frame.serial = last.serial;
    published = simulation.ticks, answered = last.serial;
    frame.seconds = now;
    frame.busy = busy;
    frame.work = simulation.work;
    frame.solution_age = double(simulation.state().solution_age) / rate;
    frame.solution_error = simulation.state().solution_error;
    for (int t = 0; t < most_tools; t++) {
        const ToolProxy& p = simulation.proxy[t];
        frame.contact[t] = int(p.state);
        frame.device_stiffness[t] = simulation.feedback[t].stiffness;
        frame.insertion[t] = p.insertion;
        p.total_force(frame.force + 3 * t);
        for (int k = 0; k < 3; k++) {
            frame.point[3 * t + k] = p.at.point[k];
            frame.displacement[3 * t + k] = p.displacement[k];
            frame.model_force[3 * t + k] = p.force[k];
            frame.device_force[3 * t + k] = simulation.feedback[t].force[k];
            frame.tip[3 * t + k] = p.tip[k];
            frame.axis[3 * t + k] = p.axis[k];
        }
    }
    frame.body = simulation.bodies;
    frame.piece_count = 0;
    for (const LoosePiece& p : simulation.pieces()) {
        frame.piece_state[frame.piece_count] = p.state;
        std::copy_n(p.offset, 3, frame.piece_offset + 3 * frame.piece_count++);
    }
    frame.shown_count = int(simulation.shown().size());
    simulation.displayed_displacement(simulation.shown().data(), frame.shown_count, frame.shown.data());
    frames.publish();
    if (reader_waits.exchange(false)) frame_published.post();
}

bool RealtimeLoop::wait_frame(int64_t serial, int64_t tick, double seconds) {
    const auto wanted = [&] { return frames.has_new() && (answered != serial || published >= tick); };
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (!wanted()) {
        const std::chrono::nanoseconds left(
            std::chrono::duration_cast<std::chrono::nanoseconds>(end - std::chrono::steady_clock::now()));
        if (left.count() <= 0) return false;
        reader_waits = true;
        if (!wanted() && !frame_published.wait(left.count())) return wanted();
    }
    return true;
}

void RealtimeLoop::step(Device& device, int64_t ticks, double* forces) {
    if (thread.joinable()) throw std::logic_error("the loop runs by the clock; stop it before stepping");
    for (int64_t i = 0; i < ticks; i++) {
        tick(device, false);
        for (int t = 0; t < most_tools; t++) simulation.proxy[t].total_force(forces + 3 * (most_tools * i + t));
    }
    publish(double(simulation.ticks) / rate);
}

} // namespace palpate
