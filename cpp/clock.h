#pragma once
#include <chrono>
#include <cstdint>
#include <thread>
#ifdef __linux__
#include <sys/prctl.h>
#endif

namespace palpate {

inline int64_t now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

// A thread's beat by absolute deadlines: a late tick slips the next ones, two never run in one.
class Beat {
    const std::chrono::nanoseconds period;
    std::chrono::steady_clock::time_point due = std::chrono::steady_clock::now();

public:
    explicit Beat(int rate) : period(1000000000 / rate) {
#ifdef __linux__
        prctl(PR_SET_TIMERSLACK, 1000UL); // ns; by default the kernel may wake a sleeper 50 us late
#endif
    }
    void wait() {
        due += period;
        if (auto now = std::chrono::steady_clock::now(); now > due) due = now;
        std::this_thread::sleep_until(due);
    }
};

} // namespace palpate
