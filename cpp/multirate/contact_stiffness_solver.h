#pragma once
// The stiffness of contacts by an iterative model, for a faster loop. LinearMultirateModel calls it, in a thread of its
// own or in lockstep.
#include "multigrid/multigrid_model.h"

namespace palpate {

struct StiffnessRequest {
    int64_t serial = 0; // counts up where contacts close or open
    int contacts = 0;
    ContactPatch patch[TissueModel::max_patches];
};

struct StiffnessAnswer {
    static constexpr int most = 3 * TissueModel::max_patches;
    int64_t serial = 0; // the request's
    bool good = false;  // the contacts can be prescribed together
    int contacts = 0;
    double stiffness[most * most] = {}; // (3 contacts, 3 contacts) N/mm, symmetric and positive
    std::vector<float> u;               // (3 contacts, nodes, 3) mm a mm of each contact's displacement along each axis
};

// A contact stiffness is U'K U, where column k of U is the equilibrium for a displacement of 1 mm of one contact along
// one axis, the others held. An error e of the columns makes one of order e^2. Each column has a state of its own, so
// that where patches move slowly, an iteration for each request keeps up with them.
class ContactStiffnessSolver {
public:
    explicit ContactStiffnessSolver(const MultigridModel& model) : model(model) {}
    void solve(const StiffnessRequest& request, StiffnessAnswer& answer); // allocates
    void reset() { serial = -1; }
    StiffnessAnswer blank() const;

private:
    const MultigridModel& model;
    std::vector<std::unique_ptr<ModelState>> column;
    int64_t serial = -1; // of the last request
};

} // namespace palpate
