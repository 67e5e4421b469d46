#include "empty.h"
#include "clock.h"
#include <stdexcept>

namespace palpate {

Empty empty_beat(int ticks, int rate) {
    if (ticks < 1 || rate < 1) throw std::invalid_argument("empty_beat: ticks and rate are at least 1");
    Empty out;
    out.woken.resize(size_t(ticks));
    std::thread([&] { // of its own, since the timer's slack is a thread's
        using clock = std::chrono::steady_clock;
        const std::chrono::nanoseconds period(1000000000 / rate);
#ifdef __linux__
        prctl(PR_SET_TIMERSLACK, 1000UL);
#endif
        auto due = clock::now();
        for (double& woken : out.woken) {
            due += period;
            if (auto now = clock::now(); now > due) {
                out.late++;
                due = now;
            }
            std::this_thread::sleep_until(due);
            woken = std::chrono::duration<double>(clock::now() - due).count();
        }
    })
        .join();
    return out;
}

} // namespace palpate
