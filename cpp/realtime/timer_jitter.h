// Measures the machine's own jitter: how late a thread wakes at a fixed rate, with no work or with memory to read.
// Called from Python (`palpate doctor`, the study of real time); each measurement starts a thread of its own.
#pragma once
#include <vector>

namespace palpate {

// The delays of a thread that does nothing: the 1 kHz loop without its work.
struct TimerJitter {
    std::vector<double> delay; // s from each tick's deadline to its start
    int missed = 0;            // deadlines, as the loop counts them
};

TimerJitter measure_timer_jitter(int ticks, int rate);

// The seconds that each tick takes to read `bytes` of memory, the same ones each time.
std::vector<double> measure_read_times(int ticks, int bytes, int rate);

bool realtime_priority_allowed();

} // namespace palpate
