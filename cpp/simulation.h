#pragma once
#include "proxy.h"
#include <memory>

namespace palpate {

// What a tick does besides the model; all of it is part of a record.
struct Settings {
    int sweeps = 4;    // of the model, a tick
    double radius = 5; // of the contact, mm
    double limit = 20; // N, the most that a device is pushed with
    double ramp = 0.1; // N a tick, the fastest that the push may rise; it may fall at once
    Pace pace;
};

// A tissue and a tool in lockstep: equal commands give equal bits, on any machine of the same instruction set.
class Simulation {
public:
    Simulation(const Model& model, const Surface& surface, const Settings& settings);

    // One tick. Reads no clock, allocates nothing, takes no lock.
    void tick(const Command& command);

    uint64_t digest() const; // of the displacements and the force, to compare replays

    int64_t ticks = 0;
    int64_t faults = 0;           // ticks whose answer was no number: force zero, tissue home
    double force[3] = {0, 0, 0};  // N, of the tissue on the tool
    double pushed[3] = {0, 0, 0}; // N, what the device feels: limited and ramped
    Proxy proxy;
    const Settings settings;
    void show(const int* nodes, int count, float* out) { model.show(*state, nodes, count, out); }
    void displacement(double* out) const { model.displacement(*state, out); } // of every node; not in a tick
    int nodes() const { return model.nodes(); }
    void follow_clock(bool on) { on ? model.accompany(*state) : model.leave(*state); }
    void lack_tables(bool on) { state->tables = on ? Tables::without : Tables::at_once; } // in lockstep
    bool cold() const { return state->cold; }

private:
    const Model& model;
    const Surface& surface;
    std::unique_ptr<State> state;
    SurfaceScratch scratch;
    bool home = true;         // at rest and untouched: nothing to do
    void watch(bool holding); // for answers that are no numbers, and for the way home to end
    void push();
};

} // namespace palpate
