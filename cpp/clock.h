#pragma once
#include <chrono>
#include <cstdint>
#include <thread>
#ifdef __linux__
#include <sched.h>
#include <sys/prctl.h>
#endif

namespace palpate {

inline int64_t now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

// The calling thread is to wake when it asked to: ahead of all ordinary threads where the system lets it (Linux: root,
// or a limit `rtprio` of 1), and no later than the timer allows. False: it waits its turn. Threads that it starts are
// ordinary.
inline bool wake_promptly() {
#ifdef __linux__
    prctl(PR_SET_TIMERSLACK, 1000UL); // ns; by default the kernel may wake a sleeper 50 us late
    if (std::thread::hardware_concurrency() < 2) return false; // the only processor is not for one thread
    const sched_param lowest{1};
    return sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &lowest) == 0;
#else
    return false;
#endif
}

// A thread's beat by absolute deadlines: a late tick slips the next ones, two never run in one. After one it rests a
// moment, so that a beat too fast for its work leaves the processor to others now and then.
class Beat {
    using clock = std::chrono::steady_clock;
    const std::chrono::nanoseconds period;
    clock::time_point due = clock::now();

public:
    int64_t late = 0;

    explicit Beat(int rate) : period(1000000000 / rate) { wake_promptly(); }
    std::chrono::nanoseconds behind() const { return clock::now() - due; }        // since it should have begun
    std::chrono::nanoseconds left() const { return due + period - clock::now(); } // until the next one
    void wait() {
        due += period;
        if (auto now = clock::now(); now > due) {
            late++;
            due = now + period / 20;
        }
        std::this_thread::sleep_until(due);
    }
};

} // namespace palpate
