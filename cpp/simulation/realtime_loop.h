#pragma once
// The 1 kHz loop. A thread of its own ticks the simulation by the clock (start, stop), or the caller does in lockstep
// (step). What others read goes through wait-free buffers; each has one reader, in the thread of the Python session.
#include "base/platform.h"
#include "realtime/latency_histogram.h"
#include "realtime/spsc_queue.h"
#include "realtime/triple_buffer.h"
#include "simulation/simulation.h"
#include <atomic>
#include <chrono>
#include <thread>

namespace palpate {

// What a display needs of one tick. Arrays hold the tools one after another.
struct Frame {
    int64_t tick = 0, late = 0, faults = 0, serial = 0; // serial: of the newest command obeyed
    int64_t body = 0;                                   // how often the body was changed
    double seconds = 0;                                 // the loop's clock
    double busy = 0;                                    // seconds of work a tick, smoothed
    double work = 0;                                    // N mm, of the tools on the tissue
    double solution_age = 0, solution_error = 0;        // s; relative: of ModelState
    int contact[most_tools] = {};                       // ContactState
    double point[3 * most_tools] = {};                  // mm, the contact on the surface at rest
    double displacement[3 * most_tools] = {};           // mm, of the tissue there
    double force[3 * most_tools] = {};                  // N, on the tool: model_force and what keeps it passive
    double model_force[3 * most_tools] = {};            // N, the model's answer
    double device_force[3 * most_tools] = {};           // N, `force` limited for a device
    double device_stiffness[most_tools] = {};           // N/mm, Feedback::stiffness
    double tip[3 * most_tools] = {};                    // mm
    double insertion[most_tools] = {};                  // mm of a needle inside the tissue
    double axis[3 * most_tools] = {};                   // of a needle
    std::vector<float> shown;                           // (shown nodes, 3) mm, displacement; then unused room
    int shown_count = 0;                                // of these nodes
    int piece_count = 0;                                // loose pieces beside the body
    PieceState piece_state[most_pieces] = {};           // of each of these
    double piece_offset[3 * most_pieces] = {};          // mm, from where each came free
};

struct CommandEvent { // a command and the tick that first obeyed it
    int64_t tick;
    int tool;
    Command command;
};

struct StateDigest { // of the state after `ticks` ticks
    int64_t ticks;
    uint64_t value;
};

// Seconds that one sweep of the model takes on this machine, at best, with a contact of `radius` mm somewhere.
double sweep_seconds(const TissueModel& model, const ContactSurface& surface, double radius);

// Every change of command, every change of model or tables and a digest now and then are kept for the recording.
class RealtimeLoop {
public:
    static constexpr int rate = 1000;        // ticks a second
    static constexpr int frame_ticks = 10;   // a frame for display is published every so many ticks
    static constexpr int answer_ticks = 3;   // sooner if it is the first to obey a command
    static constexpr int digest_ticks = 100; // a digest is kept every so many ticks

    RealtimeLoop(const TissueModel& model, const ContactSurface& surface, const SimulationSettings& settings,
                 std::vector<int> shown);
    ~RealtimeLoop();

    void start(Device& device); // the device must outlive the run
    void stop();                // takes the tools away first: the last force is zero
    bool running() const { return thread.joinable(); }

    // `ticks` ticks without a clock; forces: (ticks, tools, 3) N. Not while the thread runs.
    void step(Device& device, int64_t ticks, double* forces);

    void look_ahead() { simulation.look_ahead(last); } // as between ticks by the clock; not while the thread runs

    // Another model of the same tissue, blended in from the next tick on. False: one is on its way already. Both models
    // must outlive the loop.
    bool change(const TissueModel& model, int sweeps);
    // A body that was cut, at once: its model, its surface, the nodes to show, at most `shown_room`, and the pieces
    // beside it. All must outlive its run.
    bool change_body(const TissueModel& model, const ContactSurface& surface, int sweeps, std::vector<int> shown,
                     LoosePieces loose);
    const size_t shown_room;
    bool change_pending(); // whether another one would be refused; from the thread that changes
    void free_retired();   // frees the model that a change has replaced; from the thread that changes

    // Waits for an unread frame that obeys another command than `serial`, or is of `tick` or later; for `seconds` at
    // most. True if there is one. The loop wakes the reader without a lock.
    bool wait_frame(int64_t serial, int64_t tick, double seconds);

    Simulation& current() { return simulation; } // not while the thread runs
    TripleBuffer<Frame> frames;
    SpscQueue<CommandEvent> command_events;
    SpscQueue<StateDigest> digests;
    SpscQueue<int64_t> changes;                               // ticks that first ran another model or body
    LatencyHistogram tick_time, processor_time, wake_latency; // by the clock; wake_latency: start after the deadline
    SpscQueue<TableEvent> table_events;

private:
    Simulation simulation;
    Commands last;
    std::atomic<ActiveModel*> requested{nullptr}, retired{nullptr};
    int64_t late = 0;
    std::atomic<int64_t> published{0}, answered{0}; // tick and serial of the last frame
    double busy = 0;
    int missing_tables = 0;
    std::atomic<bool> stopping{false};
    std::atomic<bool> reader_waits{false};
    Semaphore frame_published; // posted when a reader waits
    std::thread thread;
    void run(Device& device);
    ActiveModel* changing = nullptr; // the loop's: where a change in progress will leave the retired model
    bool pending = false;            // the requesting thread's
    void tick(Device& device, bool by_clock);
    void accept_change();
    bool request(ActiveModel to);
    void publish(double seconds);
};

} // namespace palpate
