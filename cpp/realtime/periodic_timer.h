// Wakes a thread at a fixed rate, with real-time priority where the system allows it.
// Used by the 1 kHz loop, the servo and device threads, each on its own thread.
#pragma once
#include "base/platform.h"
#include <chrono>
#include <cstdint>
#include <thread>

namespace palpate {

inline int64_t now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

inline double seconds(std::chrono::steady_clock::duration d) { return std::chrono::duration<double>(d).count(); }

// Ticks by absolute deadlines. A missed deadline shifts all later ones: ticks are never made up for. After a missed one
// the thread sleeps for a twentieth of the period, so that an overloaded loop still leaves the processor to others.
class PeriodicTimer {
    using clock = std::chrono::steady_clock;
    const std::chrono::nanoseconds period;
    clock::time_point due = clock::now();

public:
    int64_t missed = 0; // deadlines

    explicit PeriodicTimer(int rate) : period(1000000000 / rate) { request_realtime_priority(); }
    std::chrono::nanoseconds lateness() const { return clock::now() - due; }           // since the deadline
    std::chrono::nanoseconds remaining() const { return due + period - clock::now(); } // until the next deadline
    void wait() {
        due += period;
        if (auto now = clock::now(); now > due) {
            missed++;
            due = now + period / 20;
        }
        std::this_thread::sleep_until(due);
    }
};

} // namespace palpate
