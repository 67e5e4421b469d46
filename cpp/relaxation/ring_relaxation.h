#pragma once
// The base of models that are relaxed ring by ring from the contact: MassSpring and BlockGaussSeidel. Simulation calls
// it through TissueModel, in the loop's thread; its solve() is also called from Python.
#include "linalg/block_csr.h"
#include "linalg/saddle_point.h"
#include "relaxation/mode_deflation.h"
#include "tissue/tissue_model.h"

namespace palpate {

// All nodes in breadth-first order from the contact nodes, which are ring 1.
struct BreadthFirstRings {
    explicit BreadthFirstRings(int nodes);
    void build(const SparsityPattern& graph, const int* contact_nodes, int count); // allocates nothing
    std::vector<int> order; // every node, ring by ring; nodes that no path of edges reaches come last
    std::vector<int> ring;  // of each node; 1 before the first contact
    int ring_count = 1;
};

struct RingRelaxationState : ModelState {
    RingRelaxationState(int nodes, int unknowns, bool springs);
    BreadthFirstRings rings;
    std::vector<int> contact_nodes; // nodes of all patches together, the first contact_node_count
    int contact_node_count = 0, contacts = 0;
    std::vector<int> contact_index; // (nodes) place in contact_nodes, or -1
    std::vector<double> weight;     // (contacts, ContactPatch::capacity) of the contact nodes
    std::vector<double> new_weight; // the same for the patches of this call
    SaddlePoint saddle;             // equilibrium of the contact nodes under the constraints
    std::vector<double> rhs;        // its right-hand side, then its solution
    // Mass-spring only: each node's home spring and the sum of its springs, N/mm; relaxation over that sum, 0 for fixed
    // nodes; u during the sweeps, four numbers per node.
    std::vector<double> home_spring, spring_sum, step, padded_u;
    ModeDeflation::Constraints mode_constraints; // block Gauss-Seidel only
    bool independent = true;                     // the contacts are linearly independent
};

// Static equilibrium K u = W f under W'u = d. Ring 1 is solved exactly: the contact nodes together with the constraint
// (a small saddle-point system, factored when the patches change), so the constraint holds after every sweep, and f is
// its multiplier. Every other node is relaxed in the order of the rings, by successive over-relaxation. Each step
// lowers the energy over its own unknowns (0 < relaxation < 2), so every sweep lowers the energy, and the limit is the
// direct solution. All float64: rounding K to float32 would move the solution by its condition number times 1e-7.
class RingRelaxation : public TissueModel {
public:
    static constexpr int most_contacts = 16; // of solve()

    int nodes() const override { return graph.nodes(); }
    std::unique_ptr<ModelState> make_state() const override;
    bool relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed, double* displacement,
               int iterations, double* force) const override;

    // `sweeps` sweeps for up to most_contacts contacts. False, and the state is unchanged, if they have more than
    // ContactPatch::capacity nodes together or are linearly dependent. displacement, force: (contacts, 3).
    bool solve(ModelState& state, const ContactPatch* patches, int contacts, const double* displacement, int sweeps,
               double* force) const;

    // out = K u, N: the external force on each node that balances it. (nodes, 3).
    virtual void internal_force(const ModelState& state, double* out) const = 0;

    // energy = u'Ku / 2 and residual = r' M^-1 r / 2 in N mm, M the diagonal (blocks) of K, r = residual().
    // force: (contacts, 3) of the tissue on the tools, from solve().
    void energy_and_residual(const ModelState& state, const double* force, double* energy, double* residual) const;

    // out = r = W f - K u at the free nodes, 0 at the others, N. (nodes, 3).
    void residual(const ModelState& state, const double* force, double* out) const;

protected:
    RingRelaxation(SparsityPattern graph, std::vector<uint8_t> fixed, double relaxation, int unknowns);
    const SparsityPattern graph;      // edges between nodes, without the diagonal
    const std::vector<uint8_t> fixed; // (nodes) 1: cannot move
    const double relaxation;
    const int unknowns; // of one node that K couples: 3, or 1 if x, y and z are independent

    bool set_contacts(RingRelaxationState& s, const ContactPatch* patches, int contacts) const;
    void solve_contact_nodes(RingRelaxationState& s, const double* displacement, double* force) const;

private:
    virtual void update_stiffness(RingRelaxationState& s) const = 0; // after a change of the contacts or their weights
    virtual void contact_matrix(RingRelaxationState& s, double* A) const = 0; // K of the contact nodes, lower triangle
    virtual void contact_rhs(RingRelaxationState& s) const = 0;               // rhs = -K u of their neighbours, N
    virtual void begin_sweeps(RingRelaxationState&) const {}                  // u may have been set by a caller
    virtual void sweep(RingRelaxationState& s, int first) const = 0;          // once over order[first ..]
    virtual void end_sweeps(RingRelaxationState&) const {}                    // stores u, except at the contact nodes
    virtual double preconditioned_norm2(const RingRelaxationState& s, int node,
                                        const double r[3]) const = 0; // r'M^-1 r
    virtual bool stiffness_depends_on_weights() const = 0;
    virtual bool rigid_contact() const { return false; } // every contact node, not the mean, gets the displacement
    virtual void apply_rigid_contact(RingRelaxationState&, const double*, double*) const {}
    virtual void set_mode_constraints(RingRelaxationState&) const {} // after a change of the contacts
    virtual void deflate(RingRelaxationState&) const {}              // minimises over the slow modes
    void factor_constraints(RingRelaxationState& s) const;
};

} // namespace palpate
