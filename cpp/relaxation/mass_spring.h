#pragma once
// The mass-spring model of the dissertation. Simulation calls it through TissueModel, in the loop's thread.
#include "relaxation/ring_relaxation.h"

namespace palpate {

// The ratio of spring constants RSC = k_h / k_e as a function of the ring r (1 at the contact).
struct SpringLaw {
    enum class Kind { uniform, linear, exponential } kind = Kind::uniform;
    double a = 0.1; // uniform: RSC = a; linear: RSC = a r; exponential: RSC = 1 - exp(a r), a < 0
    // r is the number of the ring (the dissertation), or 1 + distance from the contact in edge lengths, which changes
    // without steps when a contact moves.
    bool by_distance = false;
    double edge = 1; // mm, if by_distance
    double operator()(double ring) const;
};

// Each node is tied to its place at rest by a home spring k_h and to its neighbours by linear springs k_e (u_j - u_i).
// x, y and z are independent.
class MassSpring : public RingRelaxation {
public:
    // edges: symmetric, no diagonal. stiffness: of each edge's spring, N/mm > 0. position: (nodes, 3) mm at rest.
    // rigid: every contact node moves with the tool (the dissertation's contact), not only the weighted mean.
    MassSpring(SparsityPattern edges, const double* stiffness, const double* position, std::vector<uint8_t> fixed,
               SpringLaw law, double relaxation, bool rigid);
    void internal_force(const ModelState& state, double* out) const override;
    // The dissertation's deformed-node index table, from rest: sweeps go over the first `rows` rows, and a row is
    // joined to them while some node of the last one has moved by `least` mm. They end when no node steps by that much.
    // Nodes in no row of the table stay at home. Returns the rows of the table, 0 for contacts that cannot be held
    // together. sweeps: at most these, then those done. force: (contacts, 3). Allocates; not for the loop.
    int solve_rows(ModelState& state, const ContactPatch* patches, int contacts, const double* displacement,
                   double least, int rows, int* sweeps, double* force) const;
    // A lower bound of the eigenvalues of diag(K)^-1 K for the contact of `state`: 1 - rho, rho <= sum / (sum + home).
    double eigenvalue_bound(const ModelState& state) const;

private:
    std::vector<double> stiffness, edge_sum, position; // edge_sum: (nodes) of the edge springs
    const SpringLaw law;
    const bool rigid;
    void update_stiffness(RingRelaxationState& s) const override;
    void contact_matrix(RingRelaxationState& s, double* A) const override;
    void contact_rhs(RingRelaxationState& s) const override;
    void begin_sweeps(RingRelaxationState& s) const override;
    void sweep(RingRelaxationState& s, int first) const override;
    void sweep_rows(RingRelaxationState& s, int first, int last) const; // order[first .. last)
    void end_sweeps(RingRelaxationState& s) const override;
    double preconditioned_norm2(const RingRelaxationState& s, int node, const double r[3]) const override;
    bool stiffness_depends_on_weights() const override { return law.by_distance; }
    bool rigid_contact() const override { return rigid; }
    void apply_rigid_contact(RingRelaxationState& s, const double* displacement, double* force) const override;
    void node_force(const RingRelaxationState& s, int node, double out[3]) const;
};

} // namespace palpate
