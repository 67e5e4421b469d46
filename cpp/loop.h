#pragma once
#include "latest.h"
#include "ring.h"
#include "simulation.h"
#include "tally.h"
#include <atomic>
#include <exception>
#include <thread>

namespace palpate {

// What a display needs of one tick.
struct Frame {
    int64_t tick = 0, late = 0, faults = 0, serial = 0; // serial: of the command obeyed
    double seconds = 0;                                 // the loop's clock
    double busy = 0;                                    // seconds a tick takes, smoothed
    double work = 0;                                    // N mm that the tools have put into the tissue
    int grip[most_tools] = {};
    double point[3 * most_tools] = {}, displacement[3 * most_tools] = {}; // tool by tool
    double force[3 * most_tools] = {}, pushed[3 * most_tools] = {};
    double answer[3 * most_tools] = {}; // of `force`, what the model said
    double tip[3 * most_tools] = {}, inside[most_tools] = {}, axis[3 * most_tools] = {};
    std::vector<float> shown; // (shown nodes, 3) mm, displacement
};

struct Obeyed { // a command and the tick that first obeyed it
    int64_t tick;
    int tool;
    Command command;
};

struct Changed { // another model, and the tick that first ran it
    int64_t tick;
    const Model* model;
};

struct Digest { // of the state after `ticks` ticks
    int64_t ticks;
    uint64_t value;
};

// Seconds that one sweep of the model takes on this machine, at best, with a contact of `radius` mm somewhere.
double sweep_seconds(const Model& model, const Surface& surface, double radius);

// Drives a simulation: with a thread and a clock (start, stop), or in lockstep (step). Either way every change of
// command and a digest of the state now and then are kept for the record.
class Loop {
public:
    static constexpr int rate = 1000;        // ticks a second
    static constexpr int frame_ticks = 10;   // a frame for display is published every so many ticks
    static constexpr int answer_ticks = 3;   // and sooner, if it is the first to obey a command
    static constexpr int digest_ticks = 100; // and a digest kept

    Loop(const Model& model, const Surface& surface, const Settings& settings, std::vector<int> shown);
    ~Loop();

    void start(Device& device); // the device must outlive the run
    void stop();                // lets go first: the last force is zero
    bool running() const { return thread.joinable(); }

    // `ticks` ticks without a clock; forces: (ticks, tools, 3) N. Not while the thread runs.
    void step(Device& device, int64_t ticks, double* forces);

    void look_ahead() { simulation.look_ahead(last); } // as between ticks by the clock; not while the thread runs

    // Another model of the same tissue, blended in from the next tick on. False: one is on its way already. Both models
    // must outlive the loop.
    bool change(const Model& model, int sweeps);
    void tidy(); // throws away what a change has left behind; from the thread that changes

    Simulation& now() { return simulation; } // not while the thread runs
    Latest<Frame> frames;
    Ring<Obeyed> obeyed;
    Ring<Digest> digests;
    Ring<Changed> changes;
    Tally worked, computed, woken; // by the clock: a tick's time, its thread's processor time, and how late it began
    Ring<Switch> switches;

private:
    Simulation simulation;
    const std::vector<int> shown;
    Commands last;
    std::atomic<Running*> coming{nullptr}, gone{nullptr};
    int64_t late = 0, published = 0, answered = 0; // ticks and serial of the last frame
    double busy = 0;
    int lacking = 0;
    std::atomic<bool> stopping{false};
    std::thread thread;
    void run(Device& device);
    Running* changed = nullptr; // the loop's: the shell of a change that is under way
    bool pending = false;       // the changer's
    void tick(Device& device, bool by_clock);
    void take_change();
    void publish(double seconds);
};

} // namespace palpate
