#pragma once
// The thread of a MultirateState that solves for equilibria at finite strain, beside the 1 kHz loop. The loop's thread
// hands it one request at a time and takes the answer; neither waits for the other.
#include "base/platform.h"
#include "hyperelastic/equilibrium_solver.h"
#include "realtime/triple_buffer.h"
#include <atomic>
#include <thread>

namespace palpate {

class EquilibriumThread {
public:
    EquilibriumThread(EquilibriumSolver& solver, const EquilibriumAnswer& blank);
    ~EquilibriumThread();
    // For the loop's thread, which may write a request and send it while it is free, and read an answer while it has
    // one.
    bool is_free() const { return !busy.load(std::memory_order_acquire) && !answers.has_new(); }
    bool has_answer() const { return answers.has_new(); }
    EquilibriumRequest& request() { return requests.write_slot(); }
    void send();
    const EquilibriumAnswer& answer() { return answers.latest(); }

private:
    EquilibriumSolver& solver;
    TripleBuffer<EquilibriumRequest> requests;
    TripleBuffer<EquilibriumAnswer> answers;
    std::atomic<bool> busy{false}, stopping{false};
    Semaphore sent;
    std::thread thread;
    void run();
};

} // namespace palpate
