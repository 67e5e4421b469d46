#pragma once
#include "model.h"
#include "modes.h"
#include "saddle.h"
#include <cstdint>
#include <vector>

namespace palpate {

// Which nodes an edge joins: neighbour[start[i] .. start[i + 1]], without i itself.
struct Graph {
    std::vector<int> start, neighbour;
    int nodes() const { return int(start.size()) - 1; }
};

// The dissertation's deformed-node index table: nodes in breadth-first rows from the touched ones, which are row 1.
struct Rings {
    explicit Rings(int nodes);
    void grow(const Graph& graph, const int* touched, int count); // allocates nothing
    std::vector<int> order; // every node, row by row; nodes that no path of edges reaches come last
    std::vector<int> row;   // of each node; 1 before the first touch
    int rows = 1;
};

// State of a model that is relaxed ring by ring.
struct RingState : State {
    RingState(int nodes, int unknowns, bool springs);
    Rings rings;
    std::vector<int> touched; // nodes of all patches together, the first `count`
    int count = 0, contacts = 0;
    std::vector<int> place;     // of a node among the touched, or -1
    std::vector<double> weight; // (contacts, Patch::capacity) of the touched nodes
    std::vector<double> fresh;  // the same for the patches that arrive
    Saddle saddle;              // the touched nodes' own equilibrium
    std::vector<double> right;  // its right-hand side, then its solution
    // Springs only: home spring of each node, N/mm; with its edge springs; relaxation over that, 0 where it stands
    // still; and u while it is relaxed, four numbers a node so that one is one vector.
    std::vector<double> home, total, share, wide;
    Modes::Bound bound; // blocks only: what the contacts leave of the slow modes
    bool sound = true;  // false: two of the contacts cannot be told apart
};

// Quasi-static equilibrium K u = W f under W'u = d, relaxed ring by ring outwards from the touched nodes. Row 1 is
// solved as one: the touched nodes together with the constraint (a small saddle-point system, factored when the patch
// changes), so the constraint holds exactly after every sweep and f is its multiplier. Every other row is solved node
// by node with over-relaxation. Each step lowers the energy over its own unknowns (0 < relaxation < 2), so the energy
// falls with every sweep and the limit is the sparse direct solution. All float64: the matrix fits the cache at haptic
// sizes, and rounding K to float32 would move the solution by its condition number times 1e-7.
class RingModel : public Model {
public:
    static constexpr int most_contacts = 16;

    int nodes() const override { return graph.nodes(); }
    std::unique_ptr<State> start() const override;
    bool advance(State& state, const Patch* patches, int closed, int open, double* displacement, int sweeps,
                 double* force) const override;

    // The same for several contacts at once. False, and nothing moved, when they are more than most_contacts, hold more
    // than Patch::capacity nodes together, or cannot be told apart. displacement, force: (contacts, 3).
    bool solve(State& state, const Patch* patches, int contacts, const double* displacement, int sweeps,
               double* force) const;

    // K u, N: the force that each node needs from outside to stay where it is. out: (nodes, 3).
    virtual void internal_force(const State& state, double* out) const = 0;

    // energy = u'Ku / 2 and residual = r' M^-1 r / 2 (N mm), M the diagonal (blocks) of K, r what is out of balance at
    // the nodes that may move. force: (contacts, 3), of the tissue on the tools, as solve() left it.
    void balance(const State& state, const double* force, double* energy, double* residual) const;

    // r, N: what is out of balance at the nodes that may move, 0 elsewhere. out: (nodes, 3).
    void residual(const State& state, const double* force, double* out) const;

protected:
    RingModel(Graph graph, std::vector<uint8_t> held, double relaxation, int unknowns);
    const Graph graph;
    const std::vector<uint8_t> held; // (nodes) 1: stands still
    const double relaxation;
    const int unknowns; // coupled with each other at a node: 3, or 1 when x, y and z do not mix

private:
    virtual void prepare(RingState& s) const = 0;                   // the contacts, or only their weights, have changed
    virtual void touched_matrix(RingState& s, double* A) const = 0; // lower triangle of K among the touched nodes
    virtual void touched_right(RingState& s) const = 0;             // right = -K u of the others, N
    virtual void enter(RingState&) const {}                         // before sweeps: u may be anything
    virtual void relax(RingState& s, int first) const = 0;          // one sweep over order[first ..]
    virtual void leave(RingState&) const {}                         // after them: u but for the touched nodes
    virtual double weighed(const RingState& s, int node, const double r[3]) const = 0; // r' M^-1 r
    virtual bool stiffness_follows_weights() const = 0;
    virtual bool imposed() const { return false; } // every touched node goes with its tool, not their mean alone
    virtual void impose(RingState&, const double*, double*) const {} // row 1, when they do
    virtual void bind(RingState&) const {}   // the contacts have changed: what they leave of the slow modes
    virtual void settle(RingState&) const {} // the slow modes, after some sweeps
    bool touch(RingState& s, const Patch* patches, int contacts) const;
    void constrain(RingState& s) const;
    void hold(RingState& s, const double* displacement, double* force) const;
};

} // namespace palpate
