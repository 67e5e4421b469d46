#pragma once
#include "model.h"
#include "multigrid_cycle.h"
#include "multigrid_fields.h"

namespace palpate {

// What a multigrid model remembers between ticks. Inside, nodes are in the model's own order, four numbers each.
struct MultigridState : State {
    static constexpr int history = 2;
    void rest() override;

    Field now, force;                              // u and K u
    Buffer change[history], force_change[history]; // what the last ticks added to u, and its image
    int newest = 0, kept = 0;
    Field gain, run;                      // what this tick adds, and K (u + gain)
    Field p, image_p, whole;              // the search direction; u + gain
    std::vector<Buffer> lift, image_lift; // three a contact: fields Z that move its patch, and K Z
    std::vector<double> lift_at;          // (contacts, 3 axes, 3) where the patch was when that Z was made, mm
    int lifts = 0;                        // contacts that have theirs
    std::vector<Patch> patch;             // in the model's order of nodes; the first `contacts`
    int contacts = 0;
    Buffer rhs, z, image_z;
    CycleWork work;
    std::vector<double> lever; // (3m, 3m) W'Z, factored, with its pivots
    std::vector<int> pivot;
    std::vector<double> gram, small; // (count, count) V'KV of the span: u, the changes, the lifts
    int next_row = 0;                // from which K u is refreshed
    double gained = 1;               // root of the share of the energy that the last tick's iteration took
    int span() const { return 1 + history + 3 * int(patch.size()); }
};

// Linear elasticity on linear tetrahedra, K u = W f under W'u = d, by conjugate gradients on the fields with W'e = 0,
// preconditioned by B' = (1 - Z L^-1 W') B (1 - W L'^-1 Z'), B a V-cycle and Z the coarse levels' answer to a force on
// each patch, L = W'Z: symmetric, positive where W'e = 0, and W'u = d holds after every iteration. Each solution starts
// from the least energy over u, what the last ticks changed and Z (P. F. Fischer, Comput. Methods Appl. Mech. Eng. 163
// (1998) 193), so that a steady tool needs no more than one iteration a tick.
class Multigrid : public Model {
public:
    static constexpr int most_contacts = 16;

    // cell: edge of the finest lattice, mm. sweeps: of each level on the way down, and as many up.
    Multigrid(const Elements& mesh, double cell, int sweeps, double relaxation);

    int nodes() const override { return K.nodes(); }
    std::unique_ptr<State> start() const override;

    // sweeps: iterations. Lifts are renewed one column a tick as the patch moves on. K u gains the float32 image of
    // what u gains, and each 64th of it is made anew in float64 in a tick.
    bool advance(State& state, const Patch* patches, int closed, int open, double* displacement, int sweeps,
                 double* force) const override;

    // The same for several contacts, with K u in float64 in every iteration and lifts made for these patches; may
    // allocate. False for contacts that are too many or cannot be told apart. displacement, force: (contacts, 3).
    bool solve(State& state, const Patch* patches, int contacts, const double* displacement, int iterations,
               double* force) const;

    // K u in float64, N. u, out: (nodes, 3).
    void internal_force(const double* u, double* out) const;

    // B v, (nodes, 3), held nodes 0.
    void precondition(const double* v, double* out) const;

    std::vector<int> sizes() const { return cycle.sizes(); }

    // Bytes that a steady tick of one iteration and one contact moves: the cycle's matrices, one more product, and each
    // field once where it is read or written, as if no cache held anything from one pass to the next.
    double moved() const;

private:
    struct Ordered; // the mesh, its nodes in the order of the sweeps
    struct Start;
    explicit Multigrid(const Ordered& mesh, double cell, int sweeps, double relaxation);
    const std::vector<int> order, inside; // the caller's number of each node, and back
    const BlockRows K;
    const std::vector<uint8_t> held;
    const std::vector<double> place;
    const Cycle cycle;
    void remember(MultigridState& s, int contacts) const;
    void touch(MultigridState& s, int contact, const Patch& patch) const;
    void lift(MultigridState& s, int contact, int axis) const;
    bool hold(MultigridState& s, const Patch* patches, int contacts, const double* displacement, int sweeps,
              double* force) const;
    void keep_lifts(MultigridState& s) const;
    bool pull(MultigridState& s) const;
    bool best_start(MultigridState& s, const double* displacement, Start& start) const;
    void load(MultigridState& s, const double* f) const;
    void iterate(MultigridState& s, const Start& start, int iterations, bool exact) const;
    void once(MultigridState& s, Start& start) const;
    void keep(MultigridState& s, bool exact) const;
    void report(MultigridState& s, const double* displacement, double* force) const;
    void refresh_some(MultigridState& s) const;
    void refresh(const Field& u, Field& image, int first, int last) const;
    void means(const MultigridState& s, const Column& field, double* out) const;
    void products(MultigridState& s, int slot) const;
    const float* field(const MultigridState& s, int slot) const; // slot > 0
    const float* image(const MultigridState& s, int slot) const;
    bool present(const MultigridState& s, int slot) const;
};

} // namespace palpate
