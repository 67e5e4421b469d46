#include "realtime/timer_jitter.h"
#include "realtime/periodic_timer.h"
#include <stdexcept>

namespace palpate {

TimerJitter measure_timer_jitter(int ticks, int rate) {
    if (ticks < 1 || rate < 1) throw std::invalid_argument("measure_timer_jitter: ticks and rate are at least 1");
    TimerJitter out;
    out.delay.resize(size_t(ticks));
    std::thread([&] { // a thread of its own: the priority stays with it
        PeriodicTimer timer(rate);
        for (double& delay : out.delay) {
            timer.wait();
            delay = seconds(timer.lateness());
        }
        out.missed = timer.missed;
    })
        .join();
    return out;
}

std::vector<double> measure_read_times(int ticks, int bytes, int rate) {
    if (ticks < 1 || bytes < 1 || rate < 1)
        throw std::invalid_argument("measure_read_times: ticks, bytes and rate are at least 1");
    std::vector<double> out(size_t(ticks), 0.0);
    const std::vector<float> held(size_t(bytes) / sizeof(float) + 1, 1.0f);
    volatile float sum = 0; // keeps the compiler from dropping the sum
    std::thread([&] {
        using clock = std::chrono::steady_clock;
        PeriodicTimer timer(rate);
        for (double& taken : out) {
            timer.wait();
            const auto began = clock::now();
            float here = 0;
            for (float v : held) here += v; // in order: each addition waits for the last
            sum = here;
            taken = seconds(clock::now() - began);
        }
    }).join();
    return out;
}

bool realtime_priority_allowed() {
    bool allowed = false;
    std::thread([&] { allowed = request_realtime_priority(); }).join();
    return allowed;
}

} // namespace palpate
