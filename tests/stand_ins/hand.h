// The hand and the motors behind a stand-in library: moves as a hand does, feels what the program asks for, fails on
// request, and remembers what the program did when.
#pragma once
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

struct Moment {
    int64_t tick, ns;
    double force; // N, its length, as asked for by the end of this tick
};

struct Hand {
    std::mutex gate;
    double target[3] = {0, 0, 5}, position[3] = {0, 0, 5}; // mm, any frame
    double asked[3] = {0, 0, 0};                           // N
    int64_t ticks = 0, misuse = 0, fault_tick = -1, closed = 0;
    int buttons = 0, bounces = 0;
    bool unplugged = false, absurd = false, overrun = false, refuses = false, absent = false, warm = false, enabled = false;
    double late = 0; // ms, that the next tick comes too late
    std::vector<Moment> past;

    static int64_t now() {
        return std::chrono::duration_cast<std::chrono::nanoseconds>(
                   std::chrono::steady_clock::now().time_since_epoch())
            .count();
    }
    // A tick begins: the hand has moved, at most half a millimetre.
    void begin() {
        double lateness = 0;
        {
            std::lock_guard<std::mutex> hold(gate);
            std::swap(lateness, late);
        }
        if (lateness > 0) std::this_thread::sleep_for(std::chrono::microseconds(int64_t(1000 * lateness)));
        std::lock_guard<std::mutex> hold(gate);
        ticks++;
        for (int k = 0; k < 3; k++) {
            double step = target[k] - position[k];
            position[k] += std::fabs(step) > 0.5 ? std::copysign(0.5, step) : step;
        }
        if (bounces) buttons ^= 1, bounces--;
    }
    // And ends: this is what the motors do until the next one.
    void end() {
        std::lock_guard<std::mutex> hold(gate);
        double length = std::sqrt(asked[0] * asked[0] + asked[1] * asked[1] + asked[2] * asked[2]);
        past.push_back({ticks, now(), length});
    }
    void ask(double x, double y, double z) {
        std::lock_guard<std::mutex> hold(gate);
        asked[0] = x, asked[1] = y, asked[2] = z;
    }
};

inline Hand& hand() {
    static Hand* one = new Hand; // for good: threads may outlive the end of main
    return *one;
}

extern "C" {

// For the tests: what there is to set and to read.
void stand_in_set(const char* what, double value) {
    Hand& h = hand();
    std::lock_guard<std::mutex> hold(h.gate);
    std::string name = what;
    h.fault_tick = h.ticks + 1; // the next to begin
    if (name == "x") h.target[0] = value;
    if (name == "y") h.target[1] = value;
    if (name == "z") h.target[2] = value;
    if (name == "buttons") h.buttons = int(value);
    if (name == "bounces") h.bounces = int(value);
    if (name == "unplugged") h.unplugged = value;
    if (name == "absurd") h.absurd = value;
    if (name == "overrun") h.overrun = value;
    if (name == "refuses") h.refuses = value;
    if (name == "absent") h.absent = value;
    if (name == "warm") h.warm = value;
    if (name == "late") h.late = value;
}

double stand_in_get(const char* what) {
    Hand& h = hand();
    std::lock_guard<std::mutex> hold(h.gate);
    std::string name = what;
    if (name == "ticks") return double(h.ticks);
    if (name == "misuse") return double(h.misuse);
    if (name == "closed") return double(h.closed);
    if (name == "enabled") return h.enabled;
    if (name == "force") return std::sqrt(h.asked[0] * h.asked[0] + h.asked[1] * h.asked[1] + h.asked[2] * h.asked[2]);
    if (name == "fx") return h.asked[0];
    if (name == "fy") return h.asked[1];
    if (name == "fz") return h.asked[2];
    if (name == "fault_tick") return double(h.fault_tick);
    return NAN;
}

// Ticks that ended after `ns` (steady clock) with a force, before the first that ended without one; -1: none has yet.
int64_t stand_in_ticks_with_force_after(int64_t ns) {
    Hand& h = hand();
    std::lock_guard<std::mutex> hold(h.gate);
    int64_t count = 0;
    for (const Moment& m : h.past)
        if (m.ns > ns) {
            if (m.force == 0) return count;
            count++;
        }
    return -1;
}

// Likewise from the tick of the last fault on.
int64_t stand_in_ticks_with_force_since_fault() {
    Hand& h = hand();
    std::lock_guard<std::mutex> hold(h.gate);
    int64_t count = 0;
    for (const Moment& m : h.past)
        if (h.fault_tick >= 0 && m.tick >= h.fault_tick) {
            if (m.force == 0) return count;
            count++;
        }
    return -1;
}

void stand_in_reset() {
    Hand& h = hand();
    std::lock_guard<std::mutex> hold(h.gate);
    std::memset(h.asked, 0, sizeof h.asked);
    h.target[0] = h.target[1] = h.position[0] = h.position[1] = 0;
    h.target[2] = h.position[2] = 5;
    h.ticks = h.misuse = h.closed = 0;
    h.fault_tick = -1;
    h.buttons = h.bounces = 0;
    h.unplugged = h.absurd = h.overrun = h.refuses = h.absent = h.warm = h.enabled = false;
    h.late = 0;
    h.past.clear();
}
}
