#pragma once
// Finite strain at two rates: a thread solves for equilibria, and each tick of 1 ms takes the linear force of its own
// contacts and what the newest solution adds to it. Simulation calls it through TissueModel.
// Multi-rate haptics: M. C. Cavusoglu & F. Tendick, ICRA 2000, 2458. Local models: R. J. Adams & B. Hannaford, IEEE
// Trans. Robot. Autom. 15 (1999) 465.
#include "compliance/compliance_model.h"
#include "hyperelastic/equilibrium_solver.h"
#include "multirate/solver_thread.h"

namespace palpate {

struct MultirateState : ModelState {
    MultirateState(std::unique_ptr<ModelState> linear, const HyperelasticModel& finite,
                   const std::vector<int>& vertices);
    ~MultirateState() override;
    std::vector<double>& state_vector() override { return numbers; }
    void reset() override;

    std::unique_ptr<ModelState> linear;
    EquilibriumSolver solver;
    using Thread = SolverThread<EquilibriumSolver, EquilibriumRequest, EquilibriumAnswer>;
    std::unique_ptr<Thread> thread;  // by the clock
    EquilibriumRequest asked;        // in lockstep: the last request,
    EquilibriumAnswer pending, held; // its answer until a tick takes it, and the one taken
    bool is_pending = false;

    // What ticks use.
    LocalForce local;                       // local.contacts == 0: no solution for these contacts yet
    const EquilibriumAnswer* shown = &held; // for the display: the newest, whose `local` that is if it is for these
    int contacts = 0;                       // in the last tick
    bool from_rest = true;                  // no solution has been asked for since the tissue was at rest
    int64_t serial = 0;                     // of the contacts
    int64_t ticks = 0, sent = 0;            // all; at the last request
    int latency = 0;                        // ticks from a request to its answer, the last one's
    int fading = 0;                         // ticks until what a new solution has changed at once is gone:
    double fade[LocalForce::most] = {}, faded_energy = 0;  // N on the tissue, N mm; the energy that goes with it
    double fade_from[LocalForce::most] = {};               // mm, displacement when the fading began
    double extra[LocalForce::most] = {}, extra_energy = 0; // beyond the linear force and energy, in the last tick
    double displacement[LocalForce::most] = {}, velocity[LocalForce::most] = {}; // mm, mm a tick (smoothed)
    double solved[LocalForce::most] = {};                                        // mm, of the last request,
    ContactPatch last_patch[TissueModel::max_patches];                           // and its patches
    std::vector<double> numbers; // all of these that later forces depend on, and the linear model's
};

class MultirateModel : public TissueModel {
public:
    static constexpr int fade_ticks = 16;

    // Two models of one tissue and element, which must outlive this. interval: ticks that a solution takes in lockstep.
    // stride: mm, the longest way of a tool from one solution to the next.
    MultirateModel(const ComplianceModel& linear, const HyperelasticModel& finite, int interval, double stride);

    int nodes() const override { return finite.nodes(); }
    std::unique_ptr<ModelState> make_state() const override;
    bool relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed, double* displacement,
               int iterations, double* force) const override;
    double energy(const ModelState& state, int prescribed, const double* displacement,
                  const double* force) const override;
    void displayed_displacement(ModelState& state, const int* nodes, int count, float* out) const override;
    void displacement(ModelState& state, double* out) const override;
    void prefetch(ModelState& state, const ContactPatch* patches, int count) const override;
    void begin_realtime(ModelState& state) const override;
    void end_realtime(ModelState& state) const override;

    const ComplianceModel& linear;
    const HyperelasticModel& finite;

private:
    const int interval;
    const double stride;
    void follow_contacts(MultirateState& s, int prescribed, const double* displacement) const;
    void exchange_solutions(MultirateState& s, const ContactPatch* patches) const;
    void take(MultirateState& s, const EquilibriumAnswer& answer) const;
    void write_request(MultirateState& s, const ContactPatch* patches, EquilibriumRequest& request) const;
    double scale(const MultirateState& s) const;
    void fade(MultirateState& s, int prescribed, const double* displacement) const;
    double faded_energy(const MultirateState& s) const;
    void add_extra_force(MultirateState& s, double* force) const;
    void write_numbers(MultirateState& s) const;
};

} // namespace palpate
