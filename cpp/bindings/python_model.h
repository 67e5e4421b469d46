#pragma once
// A tissue model whose equilibrium a Python function computes. By the clock a thread of the state calls it at display
// rate for the newest contacts, and the 1 kHz loop takes force and stiffness from the newest answer, as a linear model
// (multi-rate simulation: Cavusoglu & Tendick, ICRA 2000). In lockstep each tick calls it.
#include "realtime/triple_buffer.h"
#include "tissue/tissue_model.h"
#include <atomic>
#include <functional>
#include <thread>

namespace palpate {

struct ContactRequest {
    int prescribed = 0;
    ContactPatch patch[TissueModel::max_patches];
    double displacement[3 * TissueModel::max_patches] = {};
};

struct ContactAnswer { // force(d) = force - stiffness (d - displacement), N and mm; prescribed < 0: none yet
    int prescribed = -1;
    double displacement[3 * TissueModel::max_patches] = {};
    double force[3 * TissueModel::max_patches] = {};
    double stiffness[9 * TissueModel::max_patches * TissueModel::max_patches] = {};
    std::vector<double> u; // (nodes, 3) mm
};

class PythonModel : public TissueModel {
public:
    // Fills all of an answer but `prescribed` and `displacement`; false if it has none. Any thread.
    using Equilibrium = std::function<bool(const ContactRequest&, ContactAnswer&)>;

    PythonModel(int nodes, double rate, Equilibrium equilibrium);
    int nodes() const override { return count; }
    std::unique_ptr<ModelState> make_state() const override;
    bool relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed, double* displacement,
               int iterations, double* force) const override;
    void begin_realtime(ModelState& state) const override; // starts the thread
    void end_realtime(ModelState& state) const override;   // joins it

private:
    struct State;
    const int count;
    const double rate; // answers a second, at most
    const Equilibrium equilibrium;
    bool solve(const ContactRequest& request, ContactAnswer& answer) const;
    void run(State& state) const;
};

} // namespace palpate
