#include "empty.h"
#include "clock.h"
#include <stdexcept>

namespace palpate {

Empty empty_beat(int ticks, int rate) {
    if (ticks < 1 || rate < 1) throw std::invalid_argument("empty_beat: ticks and rate are at least 1");
    Empty out;
    out.woken.resize(size_t(ticks));
    std::thread([&] { // of its own, since it may run ahead of others
        Beat beat(rate);
        for (double& woken : out.woken) {
            beat.wait();
            woken = std::chrono::duration<double>(beat.behind()).count();
        }
        out.late = beat.late;
    })
        .join();
    return out;
}

std::vector<double> reading_beat(int ticks, int bytes, int rate) {
    if (ticks < 1 || bytes < 1 || rate < 1)
        throw std::invalid_argument("reading_beat: ticks, bytes and rate are at least 1");
    std::vector<double> out(size_t(ticks), 0.0);
    const std::vector<float> held(size_t(bytes) / sizeof(float) + 1, 1.0f);
    volatile float sum = 0; // so that the reading stays
    std::thread([&] {
        using clock = std::chrono::steady_clock;
        Beat beat(rate);
        for (double& seconds : out) {
            beat.wait();
            const auto began = clock::now();
            float here = 0;
            for (float v : held) here += v; // one after another: each waits for the last
            sum = here;
            seconds = std::chrono::duration<double>(clock::now() - began).count();
        }
    }).join();
    return out;
}

bool may_wake_promptly() {
    bool may = false;
    std::thread([&] { may = wake_promptly(); }).join();
    return may;
}

} // namespace palpate
