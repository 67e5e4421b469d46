#include "loop.h"
#include "clock.h"
#include <algorithm>
#include <chrono>
#include <ctime>
#include <stdexcept>

namespace palpate {
namespace {

using clock = std::chrono::steady_clock;

constexpr auto time_ahead = std::chrono::microseconds(200); // left of a period, enough for looking ahead

double seconds(clock::duration d) { return std::chrono::duration<double>(d).count(); }

std::chrono::nanoseconds processor() { // time of this thread alone: what preempts it does not count
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

double sweep_seconds(const Model& model, const Surface& surface, double radius) {
    constexpr int sweeps = 4, tries = 15;
    auto state = model.start();
    auto scratch = surface.scratch();
    Patch patch;
    for (int t = 0; t < surface.triangles(); t++) {
        Hit at;
        at.triangle = t;
        at.weight[0] = 1;
        std::copy_n(&surface.position[3 * surface.corner[3 * t]], 3, at.point);
        if (surface.patch(at, radius, scratch, patch) == Surface::Contact::good) break;
    }
    double force[3], best = 1;
    for (int i = 0; i < tries; i++) { // deeper each time: a model that is there at once would seem too quick
        double push[3] = {0, 0, -1 - 0.1 * i};
        auto began = clock::now();
        model.advance(*state, &patch, 1, 0, push, sweeps, force);
        best = std::min(best, seconds(clock::now() - began) / sweeps);
    }
    return best;
}

Loop::Loop(const Model& model, const Surface& surface, const Settings& settings, std::vector<int> shown)
    : frames(blank(shown.size())), obeyed(1 << 16), digests(1 << 16), changes(1 << 8), switches(1 << 16),
      simulation(model, surface, settings), shown(std::move(shown)) {}

Loop::~Loop() {
    stop();
    tidy();
    delete coming.load();
    delete changed;
}

void Loop::start(Device& device) {
    if (thread.joinable()) throw std::logic_error("the loop runs already");
    stopping = false;
    if (Running* to = coming.load()) to->model->accompany(*to->state);
    thread = std::thread([this, &device] { run(device); });
}

void Loop::stop() {
    if (!thread.joinable()) return;
    stopping = true;
    thread.join();
    if (Running* to = coming.load()) to->model->leave(*to->state);
}

void Loop::run(Device& device) {
    simulation.follow_clock(true);
    const auto began = clock::now();
    Beat beat(rate);
    const int64_t kept_late = late; // of earlier runs
    while (!stopping.load(std::memory_order_relaxed)) {
        const auto behind = beat.behind();
        const auto started = clock::now();
        const auto before = processor();
        tick(device, true);
        computed.add(processor() - before);
        const auto done = clock::now();
        worked.add(done - started), woken.add(behind);
        busy += 0.01 * (seconds(done - started) - busy);
        if (simulation.ticks - published >= (last.serial != answered ? answer_ticks : frame_ticks))
            publish(seconds(done - began));
        if (beat.left() > time_ahead) simulation.look_ahead(last); // nobody waits for it
        beat.wait();
        late = kept_late + beat.late;
    }
    Replay idle({}, {}, {});
    tick(idle, true); // let go, so that the device is left without force
    device.push(simulation.felt);
    simulation.follow_clock(false);
    publish(seconds(clock::now() - began));
}

void Loop::tick(Device& device, bool by_clock) {
    const Commands& commands = device.probe(simulation.ticks);
    for (int t = 0; t < most_tools; t++)
        if (!same(commands.tool[t], last.tool[t])) obeyed.put({simulation.ticks, t, commands.tool[t]});
    last = commands;
    take_change();
    if (!by_clock) simulation.lack_tables(device.lacking(simulation.ticks)); // of the model that just came, too
    simulation.tick(commands);
    if (simulation.lacking != lacking) switches.put({simulation.ticks - 1, simulation.lacking});
    lacking = simulation.lacking;
    device.push(simulation.felt);
    if (simulation.ticks % digest_ticks == 0) digests.put({simulation.ticks, simulation.digest()});
}

void Loop::take_change() {
    if (simulation.changing()) return;
    if (changed) {
        *changed = simulation.left();
        gone.store(changed, std::memory_order_release);
        changed = nullptr;
    } else if (Running* to = coming.exchange(nullptr, std::memory_order_acq_rel)) {
        changes.put({simulation.ticks, to->model});
        changed = to; // its shell takes up what the change will leave
        simulation.change(std::move(*to));
    }
}

bool Loop::change(const Model& model, int sweeps) {
    tidy();
    if (coming.load() || pending) return false;
    auto* to = new Running{&model, model.start(), sweeps};
    if (running()) model.accompany(*to->state);
    pending = true;
    coming.store(to, std::memory_order_release);
    return true;
}

void Loop::tidy() {
    Running* left = gone.exchange(nullptr, std::memory_order_acq_rel);
    if (!left) return;
    if (left->model) left->model->leave(*left->state);
    delete left;
    pending = false;
}

void Loop::publish(double now) {
    Frame& frame = frames.writing();
    frame.tick = simulation.ticks;
    frame.late = late;
    frame.faults = simulation.faults;
    frame.serial = last.serial;
    published = simulation.ticks, answered = last.serial;
    frame.seconds = now;
    frame.busy = busy;
    frame.work = simulation.work;
    for (int t = 0; t < most_tools; t++) {
        const Proxy& p = simulation.proxy[t];
        frame.grip[t] = int(p.grip);
        frame.inside[t] = p.inside;
        p.total(frame.force + 3 * t);
        for (int k = 0; k < 3; k++) {
            frame.point[3 * t + k] = p.at.point[k];
            frame.displacement[3 * t + k] = p.displacement[k];
            frame.answer[3 * t + k] = p.force[k];
            frame.pushed[3 * t + k] = simulation.felt[t].force[k];
            frame.tip[3 * t + k] = p.tip[k];
            frame.axis[3 * t + k] = p.axis[k];
        }
    }
    simulation.show(shown.data(), int(shown.size()), frame.shown.data());
    frames.publish();
}

void Loop::step(Device& device, int64_t ticks, double* forces) {
    if (thread.joinable()) throw std::logic_error("the loop runs by the clock; stop it before stepping");
    for (int64_t i = 0; i < ticks; i++) {
        tick(device, false);
        for (int t = 0; t < most_tools; t++) simulation.proxy[t].total(forces + 3 * (most_tools * i + t));
    }
    publish(double(simulation.ticks) / rate);
}

} // namespace palpate
