#pragma once
// Linear elasticity at two rates: a thread solves for the stiffness of the contacts by multigrid, and each tick of 1 ms
// multiplies with it. For meshes on which an iteration takes longer than a tick. Simulation calls it through
// TissueModel.
#include "multirate/contact_stiffness_solver.h"
#include "multirate/solver_thread.h"
#include <algorithm>

namespace palpate {

struct LinearMultirateState : ModelState {
    static constexpr int most = StiffnessAnswer::most;
    enum Layout { // of `values`
        contacts_at = 0,
        stiffness_at = 1,
        offset_at = stiffness_at + most * most,
        displacement_at = offset_at + most * most,
        observed_at = displacement_at + most,
        origin_at = observed_at + most,
        size = origin_at + most
    };
    explicit LinearMultirateState(const MultigridModel& model)
        : solver(model), pending(solver.blank()), held(pending), values(size, 0.0) {}
    std::vector<double>& state_vector() override { return values; }
    void reset() override;

    using Thread = SolverThread<ContactStiffnessSolver, StiffnessRequest, StiffnessAnswer>;
    ContactStiffnessSolver solver;
    std::unique_ptr<Thread> thread; // by the clock
    StiffnessRequest asked;         // in lockstep: the last request,
    StiffnessAnswer pending, held;  // its answer until a tick takes it, and the one taken
    bool is_pending = false;
    const StiffnessAnswer* newest = &held;
    int64_t serial = 0, ticks = 0, sent = 0; // of the contacts; all; at the last request
    int repeats = 0;                         // requests for the same patches
    int refused_events = 0;
    ContactPatch last_patch[TissueModel::max_patches];
    // The number of contacts; the stiffness in use and its difference to the newest solution's; the displacements of
    // prescribed contacts, and of observed ones; and of those whose stiffness is a guess, where they have no force.
    std::vector<double> values;
    double shown[most] = {}; // mm, of the contacts when the newest solution was last for them
    int shown_contacts = 0;
    int shown_unknowns() const { return newest->good ? 3 * std::min(shown_contacts, newest->contacts) : 0; }
    bool known() const {
        return newest->good && newest->serial == serial && newest->contacts == int(values[contacts_at]);
    }
};

class LinearMultirateModel : public TissueModel {
public:
    // model: must outlive this. interval: ticks that a solution takes in lockstep. position: (nodes, 3) mm. shear:
    // (nodes) N/mm^2. samples: some contacts, from whose stiffness that of new ones is guessed.
    LinearMultirateModel(const MultigridModel& model, int interval, std::vector<double> position,
                         std::vector<double> shear, const std::vector<ContactPatch>& samples);

    int nodes() const override { return model.nodes(); }
    std::unique_ptr<ModelState> make_state() const override;
    bool relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed, double* displacement,
               int iterations, double* force) const override;
    void displayed_displacement(ModelState& state, const int* nodes, int count, float* out) const override;
    void displacement(ModelState& state, double* out) const override;
    void begin_realtime(ModelState& state) const override;
    void end_realtime(ModelState& state) const override;

    const MultigridModel& model;

private:
    const int interval;
    const std::vector<double> position, shear;
    double most_stiff = 0;                            // of the samples: stiffness over shear modulus times radius
    double scale_of(const ContactPatch& patch) const; // N/mm, its shear modulus times its radius
    void follow_contacts(LinearMultirateState& s, const ContactPatch* patches, int prescribed,
                         const double* displacement) const;
    void exchange_solutions(LinearMultirateState& s, const ContactPatch* patches, const double* displacement) const;
    void observe(LinearMultirateState& s, const ContactPatch* patches, int prescribed, int observed,
                 double* displacement, double* force) const;
};

} // namespace palpate
