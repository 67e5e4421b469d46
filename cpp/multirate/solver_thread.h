#pragma once
// The thread of a state whose model solves beside the 1 kHz loop. The loop's thread hands it one request at a time and
// takes the answer; neither waits for the other.
#include "base/platform.h"
#include "realtime/triple_buffer.h"
#include <atomic>
#include <thread>

namespace palpate {

struct SolverEvent { // of a tick, bits of ModelState::events
    static constexpr int requested = 1, taken = 2;
};

// Solver has solve(const Request&, Answer&), which this thread alone calls.
template <class Solver, class Request, class Answer> class SolverThread {
public:
    SolverThread(Solver& solver, const Answer& blank) : solver(solver), answers(blank), thread([this] { run(); }) {}
    ~SolverThread() {
        stopping = true;
        sent.post();
        thread.join();
    }
    // For the loop's thread, which may write a request and send it while it is free, and read an answer while it has
    // one.
    bool is_free() const { return !busy.load(std::memory_order_acquire) && !answers.has_new(); }
    bool has_answer() const { return answers.has_new(); }
    Request& request() { return requests.write_slot(); }
    void send() {
        busy.store(true, std::memory_order_relaxed);
        requests.publish();
        sent.post();
    }
    const Answer& answer() { return answers.latest(); }

private:
    Solver& solver;
    TripleBuffer<Request> requests;
    TripleBuffer<Answer> answers;
    std::atomic<bool> busy{false}, stopping{false};
    Semaphore sent;
    std::thread thread;

    void run() {
        constexpr int64_t second = 1'000'000'000; // ns
        bool last = false;
        while (!last) {
            last = stopping; // a request that was sent before is still answered: a replay answers it too
            if (!requests.has_new()) {
                if (!last) sent.wait(second);
                continue;
            }
            solver.solve(requests.latest(), answers.write_slot());
            answers.publish();
            busy.store(false, std::memory_order_release);
        }
    }
};

} // namespace palpate
