#pragma once
// Linear FEM by conjugate gradients with a multigrid preconditioner. Simulation calls it through TissueModel, in the
// loop's thread; its solve() is also called from Python.
// Initial guesses: P. F. Fischer, Comput. Methods Appl. Mech. Eng. 163 (1998) 193.
#include "multigrid/field_kernels.h"
#include "multigrid/v_cycle.h"
#include "tissue/tissue_model.h"

namespace palpate {

struct ColoredMesh;

// Nodes are in the model's internal order (by colour), with four numbers each.
struct MultigridState : ModelState {
    static constexpr int history = 2;
    void reset() override;

    Field solution, Ku;                               // u and K u
    AlignedBuffer change[history], K_change[history]; // what the last ticks added to u, and its image under K
    int newest_change = 0, changes_kept = 0;
    Field increment, new_Ku;                 // what this tick adds to u, and K (u + increment)
    Field p, Kp, new_solution;               // the search direction; u + increment
    std::vector<AlignedBuffer> lift, K_lift; // three per contact: fields Z that move its patch, and K Z
    std::vector<double> lift_position;       // (contacts, 3 axes, 3) mm, the patch's centre when that Z was computed
    int lifted_contacts = 0;                 // contacts that have their lifts
    std::vector<ContactPatch> patch;         // the first `contacts`, nodes in the internal order
    int contacts = 0;
    AlignedBuffer rhs, z, Kz; // residual, preconditioned residual
    VCycleWorkspace work;
    std::vector<double> lift_means; // (3m, 3m) W'Z, factored, with its pivots
    std::vector<int> pivot;
    std::vector<double> gram, scratch; // (span, span) V'KV of the span V: u, the changes, the lifts
    int next_row = 0;                  // of K u, to be recomputed next
    double last_gain = 1;              // root of the share of the energy that the last tick's iteration removed
    int span() const { return 1 + history + 3 * int(patch.size()); }
};

// K u = W f under W'u = d, by conjugate gradients on the fields with W'e = 0. The preconditioner is
// B' = (1 - Z L^-1 W') B (1 - W L'^-1 Z'), with B a V-cycle, Z the lifts (the coarse levels' response to a force on
// each patch) and L = W'Z: symmetric, positive where W'e = 0, and W'u = d holds after every iteration. Each solution
// starts from the field of least energy in the span of u, the last ticks' changes and Z, so that one iteration per tick
// is enough for a steady tool.
class MultigridModel : public TissueModel {
public:
    static constexpr int most_contacts = 16; // of solve()

    // cell: edge of the finest lattice, mm. sweeps: of each level on the way down, and as many up.
    MultigridModel(const ElasticMesh& mesh, double cell, int sweeps, double relaxation);
    // Another stiffness of the same nodes, such as that of smoothed elements: (nodes) rows that ascend and hold their
    // diagonal. The preconditioner stays that of P1 elements, with lambda limited to `most_lambda` mu.
    MultigridModel(const ElasticMesh& mesh, const BlockCsr& stiffness, double cell, int sweeps, double relaxation);
    static constexpr double most_lambda = 5;

    int nodes() const override { return K.nodes(); }
    std::unique_ptr<ModelState> make_state() const override;

    // A tick recomputes at most one lift per contact as the patch moves, adds the float32 image of the increment to K
    // u, and recomputes a 64th of the rows of K u in float64.
    bool relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed, double* displacement,
               int iterations, double* force) const override;

    // For up to most_contacts contacts, with K u in float64 in every iteration and new lifts; may allocate. False if
    // the contacts are linearly dependent. displacement, force: (contacts, 3).
    bool solve(ModelState& state, const ContactPatch* patches, int contacts, const double* displacement, int iterations,
               double* force) const;

    // out = K u in float64, N. u, out: (nodes, 3).
    void internal_force(const double* u, double* out) const;

    // out = B v, (nodes, 3), 0 at fixed nodes.
    void precondition(const double* v, double* out) const;

    std::vector<int> level_sizes() const { return cycle.level_sizes(); }

    // Bytes read and written by a steady tick of one iteration and one contact, without caches.
    double bytes_per_tick() const;

private:
    static constexpr int most_columns = 3 * most_contacts;
    static constexpr int most_span = 1 + MultigridState::history + most_columns;
    struct InitialGuess { // a combination of the span; its first field is u
        int count, slot[most_span];
        const float *field[1 + most_span], *image[most_span]; // from 1 on; room for one more field
        double coefficient[1 + most_span], f[most_columns];
    };
    MultigridModel(const ColoredMesh& mesh, const BlockCsr* other, double cell, int sweeps, double relaxation);
    void apply_preconditioner(MultigridState& s, int fine_sweeps) const;                        // z = B rhs, Kz = K z
    const HalfBlockCsr& half() const { return own_half.nodes() > 0 ? own_half : cycle.fine(); } // K in float32
    const std::vector<int> order, internal_index; // the mesh's number of each node, and back
    const BlockCsr K;
    const std::vector<uint8_t> fixed;
    const std::vector<double> position;
    const VCycle cycle;
    const HalfBlockCsr own_half; // empty where the preconditioner's matrix is K itself
    void reserve_contacts(MultigridState& s, int contacts) const;
    void set_patch(MultigridState& s, int contact, const ContactPatch& patch) const;
    bool solve_tick(MultigridState& s, const ContactPatch* patches, int contacts, const double* displacement,
                    int iterations, double* force) const;
    void add_patch_forces(MultigridState& s, const double* f) const;
    void conjugate_gradients(MultigridState& s, const InitialGuess& guess, int iterations, bool exact) const;
    void single_iteration(MultigridState& s, InitialGuess& guess) const;
    void accept_increment(MultigridState& s, bool exact) const;
    void tool_forces(MultigridState& s, const double* displacement, double* force) const;
    void refresh_next_rows(MultigridState& s) const;
    void refresh_rows(const Field& u, Field& image, int first, int last) const;
    // In subspace_acceleration.cpp:
    void compute_lift(MultigridState& s, int contact, int axis) const;
    void update_lifts(MultigridState& s) const;
    bool factor_lift_means(MultigridState& s) const;
    bool initial_guess(MultigridState& s, const double* displacement, InitialGuess& guess) const;
    void patch_means(const MultigridState& s, const FieldView& field, double* out) const;
    void update_gram(MultigridState& s, int slot) const;
    const float* span_field(const MultigridState& s, int slot) const; // slot > 0
    const float* span_image(const MultigridState& s, int slot) const;
    bool in_span(const MultigridState& s, int slot) const;
};

} // namespace palpate
