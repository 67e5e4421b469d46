#pragma once
#include <vector>

namespace palpate {

// What the machine's timer does to a thread that does nothing: the loop's beat without its work.
struct Empty {
    std::vector<double> woken; // s after its deadline that each tick began
    int late = 0;              // ticks that missed the next deadline, as the loop counts them
};

Empty empty_beat(int ticks, int rate);

// What it does to one that adds up so many bytes each tick, always the same: s that each tick's adding took.
std::vector<double> reading_beat(int ticks, int bytes, int rate);

bool may_wake_promptly(); // ahead of ordinary threads

} // namespace palpate
