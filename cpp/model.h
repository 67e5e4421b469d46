#pragma once
#include <algorithm>
#include <memory>
#include <vector>

namespace palpate {

// A smooth contact: the weighted mean displacement sum_i weight[i] * u(node[i]) is prescribed, and the tool's force is
// spread over the nodes with the same weights (the multiplier of that constraint), so the two are work-conjugate.
struct Patch {
    static constexpr int capacity = 256;
    int count = 0;
    int node[capacity];
    double weight[capacity];        // sum to 1
    void copy(const Patch& other) { // no more than it holds
        count = other.count;
        std::copy_n(other.node, count, node);
        std::copy_n(other.weight, count, weight);
    }
};

constexpr int most_tools = 4; // at work in a loop at once

class Model;

// How a tick comes by what its model has not computed yet. at_once: it computes it (lockstep: the answer depends on
// nothing else). ahead: a thread of the state's computes what will be needed; where it is late the tick answers as near
// as it can and says so in State::cold. without: as if it were late (the replay of a tick that was).
enum class Tables { at_once, ahead, without };

// Every array of a model that changes, sized once by Model::start().
struct State {
    std::vector<double> u;        // displacement of each node, x y z, mm; a model may leave it to displacement()
    const Model* owner = nullptr; // the model that started it: states do not fit others
    Tables tables = Tables::at_once;
    bool cold = false;   // the last answer lacked tables
    bool fading = false; // it was between what older tables gave and what the newest give
    virtual ~State() = default;
    // All that a tick leaves behind, from which everything else follows: for digests, and to see that it is sound.
    virtual std::vector<double>& memory() { return u; }
    virtual void rest() { std::fill(memory().begin(), memory().end(), 0.0); } // as it was at the start
};

// What the loop asks of a tissue model. Immutable and thread-safe: what changes is in State.
class Model {
public:
    virtual ~Model() = default;
    virtual int nodes() const = 0;
    bool owns(const State& state) const { return state.owner == this; }
    virtual std::unique_ptr<State> start() const = 0; // at rest, owned

    // Moves `state` towards equilibrium by `sweeps` sweeps, warm from where it is. The first `closed` patches hold:
    // their means are displacement (closed + open, 3) mm, and force (closed + open, 3) N becomes the tissue's on the
    // tools. The next `open` ones only feel: no force, and displacement becomes where the tissue under them has gone.
    // None closed: the tissue goes home. False: these contacts cannot be answered together, and nothing moved.
    // Allocates nothing, takes no lock, reads no clock: equal inputs give equal bits.
    virtual bool advance(State& state, const Patch* patches, int closed, int open, double* displacement, int sweeps,
                         double* force) const = 0;

    // Between ticks: all patches that the next one may bring, closed or open. A model may read what it would then need,
    // so that caches hold it; answers depend on it by no bit. Allocates nothing, takes no lock.
    virtual void expect(State&, const Patch*, int) const {}

    // N mm that the tissue holds, when the tools feel `force` at `displacement` (closed, 3). Linear: half their work.
    virtual double energy(const State&, int closed, const double* displacement, const double* force) const {
        double sum = 0;
        for (int k = 0; k < 3 * closed; k++) sum -= 0.5 * displacement[k] * force[k];
        return sum;
    }

    // The displacement of some nodes for a display, (count, 3) mm, perhaps a few frames old; allocates nothing and
    // takes no lock while tables are made ahead.
    virtual void show(State& state, const int* nodes, int count, float* out) const {
        for (int i = 0; i < count; i++)
            for (int k = 0; k < 3; k++) out[3 * i + k] = float(state.u[3 * size_t(nodes[i]) + k]);
    }
    // The displacement of every node as the state stands, (nodes, 3) mm. Not in a tick.
    virtual void displacement(State& state, double* out) const { std::copy(state.u.begin(), state.u.end(), out); }
    // Begins and ends the time when ticks follow the clock.
    virtual void accompany(State& state) const { state.tables = Tables::ahead; }
    virtual void leave(State& state) const { state.tables = Tables::at_once; }

protected:
    // Means over patches that only feel, from `u`; no force on them.
    static void feel(const State& state, const Patch* patches, int closed, int open, double* displacement,
                     double* force) {
        for (int c = closed; c < closed + open; c++)
            for (int k = 0; k < 3; k++) {
                double sum = 0;
                for (int i = 0; i < patches[c].count; i++)
                    sum += patches[c].weight[i] * state.u[3 * size_t(patches[c].node[i]) + k];
                displacement[3 * c + k] = sum, force[3 * c + k] = 0;
            }
    }
};

} // namespace palpate
