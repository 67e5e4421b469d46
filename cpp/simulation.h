#pragma once
#include "proxy.h"
#include <memory>

namespace palpate {

// What a tick does besides the model; all of it is part of a record.
struct Settings {
    int sweeps = 4;    // of the model, a tick
    double limit = 20; // N, the most that a device is pushed with
    double ramp = 0.1; // N a tick, the fastest that the push may rise; it may fall at once
    Manner manner;
};

// A model and its state, ready to be ticked.
struct Running {
    const Model* model = nullptr;
    std::unique_ptr<State> state;
    int sweeps = 1;
};

// A tissue and its tools in lockstep: equal commands give equal bits, on any machine of the same instruction set.
class Simulation {
public:
    static constexpr int settle = 100, blend = 200; // ticks that a new model runs unfelt, then comes in

    Simulation(const Model& model, const Surface& surface, const Settings& settings);

    // One tick. Reads no clock, allocates nothing, takes no lock.
    void tick(const Commands& commands);

    // Between ticks: has the models read what the next tick will ask of them if the hands go on as they do. No answer
    // depends on it. Reads no clock, allocates nothing, takes no lock.
    void look_ahead(const Commands& commands);

    // Another model of the same tissue from the next tick on, blended in; gives back the one that it takes the place of
    // (none, as long as two are at work).
    bool changing() const { return next.model != nullptr; }
    void change(Running to) { next = std::move(to), since = 0; }
    Running left() { return std::move(old); } // the model that has gone, once

    uint64_t digest() const; // of the displacements and the forces, to compare replays

    int64_t ticks = 0;
    int64_t faults = 0; // ticks whose answer was no number: force zero, tissue home
    double work = 0;    // N mm that the tools have put into the tissue
    Proxy proxy[most_tools];
    Felt felt[most_tools];
    const Settings settings;
    void show(const int* nodes, int count, float* out) { shown().model->show(*shown().state, nodes, count, out); }
    void displacement(double* out) const { now.model->displacement(*now.state, out); } // of every node; not in a tick
    int nodes() const { return now.model->nodes(); }
    const Model* model() const { return shown().model; }
    void follow_clock(bool on);
    void lack_tables(int wanted); // in lockstep, as Switch says
    int lacking = 0;              // tables in the last answers

private:
    const Surface& surface;
    Running now, next, old;
    int since = 0; // ticks that `next` has run
    SurfaceScratch scratch;
    bool home = true; // at rest and untouched: nothing to do

    // The contacts of this tick: the first `closed` of `who` hold, by landing; then come those that only feel.
    int who[most_tools] = {}, closed = 0, open = 0;
    Patch patch[most_tools];
    double moved[3 * most_tools] = {}, force[3 * most_tools] = {}, other_force[3 * most_tools] = {};
    struct Past { // a tool a tick ago
        bool held = false;
        double point[3] = {}, displacement[3] = {}, force[3] = {}, tip[3] = {}, total[3] = {};
    } past[most_tools];
    Proxy soon[most_tools]; // as the next tick may have them
    Commands before;        // when last looked ahead
    double energy = 0;      // N mm, held by the tissue a tick ago
    double work_before = 0; // N mm, of `work` what was done before the tissue was last touched

    const Running& shown() const { return next.model && since > settle ? next : now; }
    void gather();
    bool answer();
    void bring_in();
    void part(Proxy& proxy) const;
    void learn_slopes();
    double freely(const Proxy& proxy, const Past& was) const;
    void charge(Proxy& proxy, const double way[3], double most) const;
    void account();
    void brake(const double way[most_tools][3], const double most[most_tools]);
    void watch(); // for answers that are no numbers, and for the way home to end
    void push();
};

} // namespace palpate
