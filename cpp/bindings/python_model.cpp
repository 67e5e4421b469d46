#include "bindings/python_model.h"
#include "bindings/module.h"
#include <chrono>
#include <cmath>

namespace palpate {

struct PythonModel::State : ModelState {
    ContactRequest asked;
    ContactAnswer answer; // the one that ticks use
    TripleBuffer<ContactRequest> requests;
    TripleBuffer<ContactAnswer> answers;
    std::atomic<bool> running{false};
    std::thread thread;

    explicit State(const ContactAnswer& none) : answer(none), answers(none) { u = none.u; }
    ~State() override { stop(); }
    void stop() {
        running = false;
        if (!thread.joinable()) return;
        if (!PyGILState_Check()) return thread.join();
        nb::gil_scoped_release interpreter; // the thread may be waiting for it
        thread.join();
    }
    void reset() override {
        ModelState::reset();
        answer.prescribed = -1;
    }
};

PythonModel::PythonModel(int nodes, double rate, Equilibrium equilibrium)
    : count(nodes), rate(rate), equilibrium(std::move(equilibrium)) {}

std::unique_ptr<ModelState> PythonModel::make_state() const {
    ContactAnswer none;
    none.u.assign(3 * size_t(count), 0.0);
    auto state = std::make_unique<State>(none);
    state->owner = this;
    return state;
}

bool PythonModel::solve(const ContactRequest& request, ContactAnswer& answer) const {
    answer.prescribed = -1;
    if (!equilibrium(request, answer)) return false;
    answer.prescribed = request.prescribed;
    std::copy_n(request.displacement, 3 * request.prescribed, answer.displacement);
    return true;
}

bool PythonModel::relax(ModelState& base, const ContactPatch* patches, int prescribed, int observed,
                        double* displacement, int, double* force) const {
    State& state = static_cast<State&>(base);
    state.stale = false;
    ContactRequest& request = state.tables == TablePolicy::background ? state.requests.write_slot() : state.asked;
    request.prescribed = prescribed;
    for (int c = 0; c < prescribed; c++) request.patch[c].copy(patches[c]);
    std::copy_n(displacement, 3 * prescribed, request.displacement);
    if (state.tables == TablePolicy::background) {
        state.requests.publish();
        if (state.answers.has_new()) state.answer = state.answers.latest();
    } else if (state.tables == TablePolicy::on_demand && prescribed > 0 && !solve(request, state.answer)) {
        return false;
    }
    std::fill_n(force, 3 * prescribed, 0.0);
    const ContactAnswer& answer = state.answer;
    if (prescribed == 0) {
        std::fill(state.u.begin(), state.u.end(), 0.0);
    } else if (answer.prescribed == prescribed) {
        const int n = 3 * prescribed;
        for (int i = 0; i < n; i++) {
            force[i] = answer.force[i];
            for (int j = 0; j < n; j++)
                force[i] -= answer.stiffness[n * i + j] * (displacement[j] - answer.displacement[j]);
        }
        std::copy(answer.u.begin(), answer.u.end(), state.u.begin());
    }
    state.stale = prescribed > 0 && answer.prescribed != prescribed;
    observe_patches(state, patches, prescribed, observed, displacement, force);
    return true;
}

void PythonModel::begin_realtime(ModelState& base) const {
    State& state = static_cast<State&>(base);
    state.tables = TablePolicy::background;
    state.running = true;
    state.thread = std::thread([this, &state] { run(state); });
}

void PythonModel::end_realtime(ModelState& base) const {
    static_cast<State&>(base).stop();
    base.tables = TablePolicy::on_demand;
}

void PythonModel::run(State& state) const {
    const std::chrono::duration<double> period(1 / rate);
    while (state.running) {
        const auto began = std::chrono::steady_clock::now();
        if (state.requests.has_new()) {
            const ContactRequest& request = state.requests.latest();
            if (request.prescribed > 0 && solve(request, state.answers.write_slot())) state.answers.publish();
        }
        std::this_thread::sleep_until(began + period);
    }
}

} // namespace palpate
