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
    double weight[capacity]; // sum to 1
};

class Model;

// Every array of a model that changes, sized once by Model::start().
struct State {
    std::vector<double> u;        // displacement of each node, x y z, mm
    const Model* owner = nullptr; // the model that started it: states do not fit others
    virtual ~State() = default;
    virtual void rest() { std::fill(u.begin(), u.end(), 0.0); } // as it was at the start
};

// What the loop asks of a tissue model. Immutable and thread-safe: what changes is in State.
class Model {
public:
    virtual ~Model() = default;
    virtual int nodes() const = 0;
    bool owns(const State& state) const { return state.owner == this; }
    virtual std::unique_ptr<State> start() const = 0; // at rest, owned

    // Moves `state` towards equilibrium by `sweeps` sweeps, warm from where it is, under patch mean = displacement mm
    // (patch null: nothing touches, the tissue goes home). `force` becomes the tissue's force on the tool, N.
    // Allocates nothing, takes no lock, reads no clock: equal inputs give equal bits.
    virtual void advance(State& state, const Patch* patch, const double displacement[3], int sweeps,
                         double force[3]) const = 0;
};

} // namespace palpate
