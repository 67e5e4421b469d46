#pragma once
// FEM at finite strain. Simulation calls it through TissueModel, in the loop's thread; its solve() is also called from
// Python. Method: M. Liu, S. Bouaziz & L. Kavan, ACM Trans. Graph. 36 (2017) 23.
#include "hyperelastic/contact_constraints.h"
#include "hyperelastic/contact_response.h"
#include "hyperelastic/hyperelastic_energy.h"
#include "linalg/lbfgs.h"
#include "linalg/sparse_cholesky.h"
#include "tissue/tissue_model.h"

namespace palpate {

// A displacement with its energy and gradient.
struct Configuration {
    Configuration(int unknowns, int elements);
    std::vector<double> u, gradient, volume_ratio; // mm; dE/du minus the tools' forces, N; J of each element
    double energy = 0;                             // N mm
    double stiffened = 0;                          // HyperelasticEnergy::Energy
};

struct HyperelasticState : ModelState {
    HyperelasticState(const HyperelasticEnergy& elements, const Supernodes& tree, const float* value,
                      const std::vector<int>& free_nodes);
    RestStiffness rest_stiffness; // K below
    ContactConstraints constraints;
    Lbfgs lbfgs;
    Configuration current, trial, other;
    std::vector<double> step, direction, preconditioned, trial_preconditioned; // K^-1 gradient of current and of trial
    std::vector<double> work;                                                  // of the elements
    std::vector<double> force;                                                 // (contacts, 3) N, tools on tissue
    std::vector<double> gap;                                                   // (contacts, 3) mm that tools have left
    double gradient_norm2 = 0;                                                 // gradient' K^-1 gradient, N mm
    bool tools_arrived = true;                                                 // no gap is left
    std::unique_ptr<ContactResponse>
        response; // if there is one, tools move along it; kept by HyperelasticModel::respond
};

// Static equilibrium at finite strain: minimises the energy of the elements under W'u = d, by L-BFGS that
// starts from the factored stiffness at rest. Every direction is projected on the constraints, so the tools keep their
// displacements after every step. A long way of a tool is split so that no element loses more than 70 % of its volume
// or stiffens by more than e at once, with a step of descent between the parts; no step is accepted that inverts an
// element.
class HyperelasticModel : public TissueModel {
public:
    static constexpr int most_contacts = 16, history = 16;

    // rest: the factored stiffness at rest of `free_nodes`, in that order. Elements and rest must outlive this.
    HyperelasticModel(const HyperelasticEnergy& elements, const SparseCholesky& rest, std::vector<int> free_nodes);

    int nodes() const override { return elements.nodes(); }
    std::unique_ptr<ModelState> make_state() const override;
    bool relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed, double* displacement,
               int iterations, double* force) const override;
    double energy(const ModelState& state, int, const double*, const double*) const override {
        return static_cast<const HyperelasticState&>(state).current.energy;
    }

    // At most `steps` steps of descent, fewer once gradient' K^-1 gradient is below tolerance^2 times twice the energy.
    // Returns the steps taken; -1, and the state is unchanged, if the contacts are more than most_contacts or linearly
    // dependent. force: (contacts, 3) N of the tissue on the tools.
    int solve(ModelState& state, const ContactPatch* patches, int contacts, const double* displacement, int steps,
              double tolerance, double* force) const;

    // For error estimates, N mm: residual = g'Hg with the inverse stiffness at rest or with the one of L-BFGS,
    // whichever is larger; size = u'K(u)u with the tangent K(u). gap: the largest of the tools' gaps, mm.
    struct Balance {
        double residual, size, gap;
    };
    Balance balance(const ModelState& state) const;

    // Improves the response of a state that has one, after a solve(), by steps of conjugate gradients in each of its
    // columns, from those of the last call, and takes stiffness, force and its error from it. read_response(): force
    // and error alone, from the columns as they are.
    void respond(HyperelasticState& s, int steps) const;
    void read_response(HyperelasticState& s) const;

    const HyperelasticEnergy& elements;

private:
    const Supernodes& tree;
    const std::vector<int> free_nodes;
    std::vector<uint8_t> fixed;
    const FactorValues<float> value;
    void evaluate_current(HyperelasticState& s) const;
    void precondition_current(HyperelasticState& s) const;
    bool evaluate(HyperelasticState& s, Configuration& at) const;
    void precondition(HyperelasticState& s, Configuration& at, std::vector<double>& out) const;
    bool move_tools(HyperelasticState& s, const double* displacement) const;
    bool descent_step(HyperelasticState& s) const;
    double line_search(HyperelasticState& s, double initial_slope) const;
    void adapt_response(HyperelasticState& s) const; // contact_response.cpp, as respond()
    void tangents(HyperelasticState& s, const double* v, double* out) const;
};

} // namespace palpate
