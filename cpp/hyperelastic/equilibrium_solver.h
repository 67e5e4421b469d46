#pragma once
// Equilibria at finite strain, one after the other, with what a faster loop needs between them. Used by multirate/, in
// a thread of its own or in lockstep, and from Python.
#include "hyperelastic/hyperelastic_model.h"
#include "hyperelastic/local_force.h"

namespace palpate {

struct EquilibriumRequest {
    int64_t serial = 0; // counts up where contacts close or open; a solution for another number is of no use
    bool from_rest = true;
    bool moving = false; // an answer that comes soon is wanted more than an exact one
    int64_t tick = 0;    // of the asker's count; the answer returns it
    int contacts = 0;
    ContactPatch patch[TissueModel::max_patches];
    double displacement[LocalForce::most] = {};
};

struct EquilibriumAnswer {
    int64_t serial = 0, tick = 0; // the request's
    bool good = false;            // the contacts can be prescribed together
    double error = 0;             // estimated, relative, of the force
    LocalForce local;
    std::vector<double> u;       // (nodes, 3) mm
    std::vector<float> response; // (3 contacts, vertices, 3) mm of u a mm of the tools
};

// One equilibrium after the other, each from the one before.
class EquilibriumSolver {
public:
    // vertices: nodes whose response is wanted. The model must outlive this.
    EquilibriumSolver(const HyperelasticModel& model, std::vector<int> vertices);
    void solve(const EquilibriumRequest& request, EquilibriumAnswer& answer); // equal requests in a row give equal bits
    EquilibriumAnswer blank() const;
    const ContactResponse& response() const { return *state->response; } // of the last solution

    const HyperelasticModel& model;

private:
    const std::vector<int> vertices;
    std::unique_ptr<HyperelasticState> state;
    int known = 0, since_response = 0; // of the last solution: its displacements' number; solutions since a response
    double displacement[LocalForce::most] = {}, last_force[LocalForce::most] = {};
    double stiffness[LocalForce::most * LocalForce::most] = {}, last_linear[LocalForce::most * LocalForce::most] = {};
    void update_stiffness(int n, const double* now, const double* linear);
};

} // namespace palpate
