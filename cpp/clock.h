#pragma once
#include <algorithm>
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
    using nanoseconds = std::chrono::nanoseconds;
    const nanoseconds period;
    clock::time_point due = clock::now();
    nanoseconds early; // before a deadline that `rest` wakes: later than that it sleeps one time in a hundred

    bool set_due() { // false: it is over already, and the next one slips
        due += period;
        const auto now = clock::now();
        if (now <= due) return true;
        late++;
        due = now + period / 20;
        return false;
    }

public:
    static constexpr nanoseconds room{10000}; // that `rest` leaves, 99 times in a hundred where it can be had
    int64_t late = 0;

    explicit Beat(int rate) : period(1000000000 / rate), early(period / 20) { wake_promptly(); }
    nanoseconds behind() const { return clock::now() - due; } // since it should have begun
    nanoseconds left() const { return due - clock::now(); }   // until the next one, after `rest`
    void wait() {
        set_due();
        std::this_thread::sleep_until(due);
    }

    // In two steps: asleep until shortly before the deadline, then awake. What sleeps wakes late, by some 50 us on a
    // virtual machine, and to caches that hold nothing of its own; what is done between the two is nobody's time.
    void rest() {
        if (!set_due() || left() < early) return std::this_thread::sleep_until(due);
        std::this_thread::sleep_until(due - early);
        const bool well = left() > room;
        early = std::clamp<nanoseconds>(early + nanoseconds(well ? -10 : 990), room, period / 8);
    }
    void hold() const { // with no pause in it: where it is virtual, the processor would be taken away for that
        while (clock::now() < due) {
        }
    }
};

} // namespace palpate
