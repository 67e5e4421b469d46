#pragma once
// A tissue and its tools, one tick at a time. Owned by RealtimeLoop and called on its thread: by the clock, or in
// lockstep. Equal commands give equal bits on any machine with the same instruction set.
#include "simulation/loose_pieces.h"
#include <memory>

namespace palpate {

// What a tick depends on besides the model; all of it is part of a recording.
struct SimulationSettings {
    int sweeps = 4;    // iterations of the model, a tick
    double limit = 20; // N, the largest force on a device
    double ramp = 0.1; // N a tick, the fastest increase of that force; it may fall at once
    ToolSettings tools;
};

// A model, its state and its iterations a tick; of a body with another surface than before also that, with room for
// queries, the nodes that a display asks for, and the pieces that its cuts have freed.
struct ActiveModel {
    const TissueModel* model = nullptr;
    std::unique_ptr<ModelState> state;
    int sweeps = 1;
    const ContactSurface* surface = nullptr;
    SurfaceScratch scratch;
    std::vector<int> shown;
    LoosePieces loose = {};
};

class Simulation {
public:
    static constexpr int settle = 100, blend = 200; // ticks that a new model runs unused, then is blended in

    Simulation(const TissueModel& model, const ContactSurface& surface, const SimulationSettings& settings,
               std::vector<int> shown = {});

    // One tick. Reads no clock, allocates nothing, takes no lock.
    void tick(const Commands& commands);

    // Between ticks: tells the models which patches the next tick will need if the tools go on as they do. No answer
    // depends on it. Reads no clock, allocates nothing, takes no lock.
    void look_ahead(const Commands& commands);

    // Another model from the next tick on: one of the same body is blended in; one with a surface of its own, a body
    // that was cut, takes over at once. Not while changing(). retired(): the model it has replaced, once; empty before
    // that.
    bool changing() const { return next.model != nullptr; }
    void change(ActiveModel to);
    ActiveModel retired() { return std::move(old); }

    uint64_t digest() const; // of the state and the forces, to compare replays

    int64_t ticks = 0;
    int64_t bodies = 0; // that have taken over
    int64_t faults = 0; // ticks whose answer was not finite: force zero, tissue reset
    double work = 0;    // N mm, of the tools on the tissue, blades too
    ToolProxy proxy[most_tools];
    Feedback feedback[most_tools];
    const SimulationSettings settings;
    void displayed_displacement(const int* nodes, int count, float* out) {
        displayed().model->displayed_displacement(*displayed().state, nodes, count, out);
    }
    void displacement(double* out) const { now.model->displacement(*now.state, out); } // of every node; not in a tick
    int nodes() const { return now.model->nodes(); }
    const std::vector<int>& shown() const { return now.shown; }
    const std::vector<LoosePiece>& pieces() const { return now.loose.piece; }
    const TissueModel* model() const { return displayed().model; }
    const ModelState& state() const { return *displayed().state; }
    void follow_clock(bool on);
    void set_missing_tables(int wanted); // in lockstep: TableEvent::missing_tables
    int missing_tables = 0;              // of the last tick

private:
    ActiveModel now, next, old;
    int since = 0;       // ticks that `next` has run
    bool at_rest = true; // and untouched: nothing to compute

    // The contacts of this tick: the first `closed` in the order in which they closed, then the open ones.
    int tool_of[most_tools] = {}, closed = 0, open = 0;
    ContactPatch patch[most_tools];
    double displaced[3 * most_tools] = {}, force[3 * most_tools] = {}, next_force[3 * most_tools] = {};
    struct PreviousTick { // of a tool
        bool closed = false, cutting = false, carrying = false;
        double point[3] = {}, displacement[3] = {}, force[3] = {}, tip[3] = {}, total[3] = {};
    } previous[most_tools];
    ToolProxy predicted[most_tools]; // look_ahead's
    Commands previous_commands;      // of the last look_ahead
    double energy = 0;               // N mm, of the tissue a tick ago
    double recent_work = 0;          // N mm, of the tools since the tissue was last untouched, and its energy then

    const ActiveModel& displayed() const { return next.model && since > settle ? next : now; }
    void gather_contacts();
    bool solve_contacts();
    void blend_models();
    void change_body();
    bool presses(const ToolProxy& proxy, const ContactSurface& on) const;
    void separate_if_pulled(ToolProxy& proxy) const;
    void check_answers();
    void write_feedback();
    // passivity.cpp
    void estimate_energy_slopes();
    double allowed_change(const ToolProxy& proxy, const PreviousTick& before) const;
    void update_drag(ToolProxy& proxy, const double way[3], double most) const;
    void observe_energy();
    void control_passivity(const double way[most_tools][3], const double most[most_tools]);
};

} // namespace palpate
