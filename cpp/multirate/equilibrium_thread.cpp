#include "multirate/equilibrium_thread.h"

namespace palpate {

EquilibriumThread::EquilibriumThread(EquilibriumSolver& solver, const EquilibriumAnswer& blank)
    : solver(solver), answers(blank), thread([this] { run(); }) {}

EquilibriumThread::~EquilibriumThread() {
    stopping = true;
    sent.post();
    thread.join();
}

void EquilibriumThread::send() {
    busy.store(true, std::memory_order_relaxed);
    requests.publish();
    sent.post();
}

void EquilibriumThread::run() {
    constexpr int64_t second = 1'000'000'000; // ns
    bool last = false;
    while (!last) {
        last = stopping; // a request that was sent before is still answered: a replay of the session answers it too
        if (!requests.has_new()) {
            if (!last) sent.wait(second);
            continue;
        }
        solver.solve(requests.latest(), answers.write_slot());
        answers.publish();
        busy.store(false, std::memory_order_release);
    }
}

} // namespace palpate
