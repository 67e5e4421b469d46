#pragma once
// The interface of a tissue model. Simulation calls it in the 1 kHz loop; the built-in models and a user's own derive
// from it. Only nodes(), make_state() and relax() must be written; the other functions have defaults.
//
// Units: mm, N, N mm. A tick is 1 ms. Nodes are numbered as in the mesh whose ContactSurface the loop uses.
// Arrays of vectors are row-major, x y z of the first entry first, float64.
//
// Threads: a model does not change after it is constructed, and its const functions may be called by several threads at
// once, each with its own state. One state is used by one thread at a time. While the loop runs that is the loop's
// thread, for every function below except make_state(), begin_realtime() and end_realtime(). No const function may hold
// a lock that another thread can hold for long. The model outlives its states.
#include "tissue/contact_patch.h"
#include <memory>
#include <vector>

namespace palpate {

class TissueModel;

// What a model does in a tick for which a precomputed table is missing. on_demand: it computes the table in the tick
// (lockstep: the answer depends on nothing else). background: a second thread of the state computes tables ahead; if it
// is late, the tick uses older ones and sets ModelState::stale. unavailable: as if that thread were late, which replays
// such a tick.
enum class TablePolicy { on_demand, background, unavailable };

// All that changes in a model. make_state() allocates it once, at its full size; models derive their own from it.
struct ModelState {
    std::vector<double> u;              // (nodes, 3) mm; unused if the model overrides displacement()
    const TissueModel* owner = nullptr; // the model that made it: a state fits no other model
    TablePolicy tables = TablePolicy::on_demand;
    bool stale = false;      // the last relax() lacked tables
    bool blending = false;   // the last relax() answered between what older tables gave and what the newest give
    double energy_shift = 0; // N mm, change of energy() in the last relax() that no tool has worked for
    bool lags = false;       // its forces follow solutions of another thread, so that tools may be given more energy
    // What a thread of the state did for the last relax(), as two bits of the model's own. A recording keeps them; in
    // its replay they are given here before the tick (else: -1), and the model does the same again in the tick.
    int events = 0, recorded_events = -1;
    // Of a model whose ticks rest on solutions of another thread: how many ticks ago the contacts of the newest one
    // were those of the tick, and the estimated relative error of its force. For the display alone.
    int solution_age = 0;
    double solution_error = 0;
    virtual ~ModelState() = default;
    // The numbers from which all later answers follow. Equal vectors and equal calls give equal bits; the loop hashes
    // them, and takes the tissue to rest if one of them is not finite.
    virtual std::vector<double>& state_vector() { return u; }
    virtual void reset() { std::fill(state_vector().begin(), state_vector().end(), 0.0); } // to rest
};

class TissueModel {
public:
    static constexpr int max_patches = 4; // prescribed and observed together, in one call of relax()

    virtual ~TissueModel() = default;
    virtual int nodes() const = 0;
    // A new state at rest, with `owner` set to this. May allocate. Not called by the loop's thread.
    virtual std::unique_ptr<ModelState> make_state() const = 0;
    bool owns(const ModelState& state) const { return state.owner == this; }

    // One tick: takes `state` towards static equilibrium by `iterations` iterations, starting from where it is.
    // The first `prescribed` patches have a tool: the patch's weighted mean displacement becomes its row of
    // displacement (prescribed + observed, 3) mm, and its row of force, same shape, becomes the force in N of the
    // tissue on the tool: a tool that pushes in by d feels force . d <= 0.
    // The next `observed` patches have none: their rows of displacement become their mean displacement, their force 0.
    // prescribed == 0: the tissue returns to rest.
    // False if these contacts cannot be prescribed together (too many nodes, or linearly dependent); the
    // displacement then stays as it was, and the loop calls again without the contact that came last.
    // Allocates nothing, takes no lock, reads no clock, does not throw: equal inputs give equal bits. It has the loop's
    // period of 1 ms, all else in the loop included.
    virtual bool relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed,
                       double* displacement, int iterations, double* force) const = 0;

    // The body was cut: the first state, new, goes on where the other one, of the body before, has come to, so that
    // forces have no step. In a tick: allocates nothing, takes no lock. False: it begins at rest.
    virtual bool continue_from(ModelState&, const ModelState&) const { return false; }

    // (3, 3) N/mm after a relax(): by how much the force of a prescribed patch would differ if its displacement did, in
    // that tick alone. Of tissue that relaxes it is steeper than force over displacement. False: not known.
    virtual bool contact_slope(const ModelState&, int /*patch*/, double* /*out*/) const { return false; }

    // Between ticks: the patches, prescribed or observed, that the next tick may bring. A model may load into the
    // caches what it would need for them. No answer may depend on this call. Allocates nothing, takes no lock.
    virtual void prefetch(ModelState&, const ContactPatch*, int) const {}

    // Elastic energy in N mm after a relax() with these displacements and forces, (prescribed, 3). The default holds
    // for linear models: half the work of the tools. The loop uses it to keep the contact passive.
    virtual double energy(const ModelState&, int prescribed, const double* displacement, const double* force) const {
        double sum = 0;
        for (int k = 0; k < 3 * prescribed; k++) sum -= 0.5 * displacement[k] * force[k];
        return sum;
    }

    // The displacement of `count` nodes for a display, (count, 3) mm; may be a few display frames old. Called by the
    // loop's thread between ticks: allocates nothing and takes no lock after begin_realtime().
    virtual void displayed_displacement(ModelState& state, const int* nodes, int count, float* out) const {
        for (int i = 0; i < count; i++)
            for (int k = 0; k < 3; k++) out[3 * i + k] = float(state.u[3 * size_t(nodes[i]) + k]);
    }
    // The displacement of every node for the state as it is, (nodes, 3) mm. May allocate; not called in the loop.
    virtual void displacement(ModelState& state, double* out) const { std::copy(state.u.begin(), state.u.end(), out); }

    // Called before the first and after the last tick that follows the clock; a model may start and join a thread of
    // its own here. Without them, ticks run in lockstep.
    virtual void begin_realtime(ModelState& state) const { state.tables = TablePolicy::background; }
    virtual void end_realtime(ModelState& state) const { state.tables = TablePolicy::on_demand; }

protected:
    // What relax() must return for the observed patches, for models that keep `u`.
    static void observe_patches(const ModelState& state, const ContactPatch* patches, int prescribed, int observed,
                                double* displacement, double* force) {
        for (int c = prescribed; c < prescribed + observed; c++) {
            patches[c].mean(state.u.data(), displacement + 3 * c);
            std::fill_n(force + 3 * c, 3, 0.0);
        }
    }
};

} // namespace palpate
