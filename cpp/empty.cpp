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

bool may_wake_promptly() {
    bool may = false;
    std::thread([&] { may = wake_promptly(); }).join();
    return may;
}

} // namespace palpate
