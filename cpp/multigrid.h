#pragma once
#include "model.h"
#include "multigrid_cycle.h"
#include "multigrid_fields.h"

namespace palpate {

// What a multigrid model remembers between ticks.
struct MultigridState : State {
    static constexpr int history = 3; // fields kept: the newest and two before
    void rest() override;

    Field field[history], image[history]; // u of earlier ticks and K u; [newest] is now
    int newest = 0, kept = 0;
    Field p, image_p;                     // the search direction
    std::vector<Buffer> lift, image_lift; // three a contact: fields Z that move its patch, and K Z
    std::vector<double> lift_at;          // (contacts, 3 axes, 3) where the patch was when that Z was made, mm
    int lifts = 0;                        // contacts that have theirs
    std::vector<Patch> patch;             // of the contacts, the first `contacts`
    int contacts = 0;
    Buffer rhs, z, image_z;
    CycleWork work;
    std::vector<double> lever; // (3m, 3m) W'Z, factored, with its pivots
    std::vector<int> pivot;
    std::vector<double> gram, scratch, small; // of the span
    int next_row = 0;                         // from which K u is refreshed
};

// Linear elasticity on linear tetrahedra, K u = W f under W'u = d, by conjugate gradients on the fields with W'e = 0,
// preconditioned by B' = (1 - Z L^-1 W') B (1 - W L'^-1 Z'), B a V-cycle and Z the coarse levels' answer to a force on
// each patch, L = W'Z: symmetric, positive where W'e = 0, and W'u = d holds after every iteration. Each solution starts
// from the least energy over what the last ticks answered and Z (P. F. Fischer, Comput. Methods Appl. Mech. Eng. 163
// (1998) 193), so that a steady tool needs no more than one iteration a tick.
class Multigrid : public Model {
public:
    static constexpr int most_contacts = 16;

    // cell: edge of the finest lattice, mm. sweeps: of each level on the way down, and as many up.
    Multigrid(const Elements& mesh, double cell, int sweeps, double relaxation);

    int nodes() const override { return K.nodes(); }
    std::unique_ptr<State> start() const override;

    // sweeps: iterations. Lifts are renewed one column a tick as the patch moves on, and K u is carried along, each
    // 64th of it made anew in a tick.
    void advance(State& state, const Patch* patch, const double displacement[3], int sweeps,
                 double force[3]) const override;

    // The same for several contacts, with K u in full and every lift made for these patches; may allocate. False for
    // contacts that are too many or cannot be told apart. displacement, force: (contacts, 3).
    bool solve(State& state, const Patch* patches, int contacts, const double* displacement, int iterations,
               double* force) const;

    // K u in float64, N. u, out: (nodes, 3).
    void internal_force(const double* u, double* out) const;

    // B v, (nodes, 3), held nodes 0.
    void precondition(const double* v, double* out) const;

    std::vector<int> sizes() const { return cycle.sizes(); }

private:
    BlockRows K;
    const std::vector<uint8_t> held;
    std::vector<double> place;
    const Cycle cycle;
    void remember(MultigridState& s, int contacts) const;
    void lift(MultigridState& s, int contact, int axis) const;
    void keep_lifts(MultigridState& s) const;
    bool pull(MultigridState& s) const;
    bool best_start(MultigridState& s, const double* displacement) const;
    void iterate(MultigridState& s, int iterations, bool exact) const; // exact: K u in full each time
    void report(MultigridState& s, const double* displacement, double* force) const;
    void refresh(MultigridState& s, int first, int last) const;
    void means(const MultigridState& s, const Column& field, double* out) const;
    void centre(const Patch& patch, double at[3], double& spread) const;
};

} // namespace palpate
