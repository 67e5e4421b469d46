// The hand and the motors behind a stand-in library: moves as a hand does, feels what the program asks for, fails on
// request, and remembers what the program did when.
#pragma once
#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <string.h>
#include <time.h>

struct Moment {
    int64_t tick, ns;
    double force; // N, its length, as asked for by the end of this tick
};

inline int64_t now() { // C++'s steady clock
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return int64_t(t.tv_sec) * 1000000000 + t.tv_nsec;
}
inline void sleep_until(int64_t ns) {
    timespec t{time_t(ns / 1000000000), long(ns % 1000000000)};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
}

struct Hand {
    pthread_mutex_t gate = PTHREAD_MUTEX_INITIALIZER;
    double target[3] = {0, 0, 5}, position[3] = {0, 0, 5}; // mm, any frame
    double asked[3] = {0, 0, 0};                           // N
    int64_t ticks = 0, misuse = 0, fault_tick = -1, closed = 0;
    int buttons = 0, bounces = 0;
    bool unplugged = false, absurd = false, overrun = false, refuses = false, absent = false, warm = false,
         snaps = false, enabled = false;
    double late = 0; // ms, that the next tick comes too late
    int64_t kept = 0;
    Moment past[1 << 17]; // two minutes of ticks

    void begin(); // a tick begins: the hand has moved, at most half a millimetre
    void end();   // and ends: this is what the motors do until the next one
    void ask(double x, double y, double z);
};

struct Hold {
    pthread_mutex_t* gate;
    explicit Hold(Hand& hand) : gate(&hand.gate) { pthread_mutex_lock(gate); }
    ~Hold() { pthread_mutex_unlock(gate); }
};

inline void Hand::begin() {
    double lateness = 0;
    {
        Hold hold(*this);
        lateness = late;
        late = 0;
    }
    if (lateness > 0) sleep_until(now() + int64_t(1e6 * lateness));
    Hold hold(*this);
    ticks++;
    for (int k = 0; k < 3; k++) {
        double step = target[k] - position[k];
        position[k] += fabs(step) > 0.5 ? copysign(0.5, step) : step;
    }
    if (bounces) buttons ^= 1, bounces--;
}

inline double length(const double v[3]) { return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

inline void Hand::end() {
    Hold hold(*this);
    if (kept < int64_t(sizeof past / sizeof *past)) past[kept++] = {ticks, now(), length(asked)};
}

inline void Hand::ask(double x, double y, double z) {
    Hold hold(*this);
    asked[0] = x, asked[1] = y, asked[2] = z;
}

inline Hand& hand() {
    static Hand* one = new Hand; // for good: threads may outlive the end of main
    return *one;
}

extern "C" {

// For the tests: what there is to set and to read.
void stand_in_set(const char* what, double value) {
    Hand& h = hand();
    Hold hold(h);
    auto is = [what](const char* name) { return !strcmp(what, name); };
    h.fault_tick = h.ticks + 1; // the next to begin
    if (is("x")) h.target[0] = value;
    if (is("y")) h.target[1] = value;
    if (is("z")) h.target[2] = value;
    if (is("buttons")) h.buttons = int(value);
    if (is("bounces")) h.bounces = int(value);
    if (is("unplugged")) h.unplugged = value;
    if (is("absurd")) h.absurd = value;
    if (is("overrun")) h.overrun = value;
    if (is("refuses")) h.refuses = value;
    if (is("absent")) h.absent = value;
    if (is("warm")) h.warm = value;
    if (is("snaps")) h.snaps = value;
    if (is("late")) h.late = value;
}

double stand_in_get(const char* what) {
    Hand& h = hand();
    Hold hold(h);
    auto is = [what](const char* name) { return !strcmp(what, name); };
    if (is("ticks")) return double(h.ticks);
    if (is("misuse")) return double(h.misuse);
    if (is("closed")) return double(h.closed);
    if (is("enabled")) return h.enabled;
    if (is("force")) return length(h.asked);
    if (is("fx")) return h.asked[0];
    if (is("fy")) return h.asked[1];
    if (is("fz")) return h.asked[2];
    if (is("fault_tick")) return double(h.fault_tick);
    return NAN;
}

// Ticks that ended after `ns` (steady clock) with a force, before the first that ended without one; -1: none has yet.
int64_t stand_in_ticks_with_force_after(int64_t ns) {
    Hand& h = hand();
    Hold hold(h);
    int64_t count = 0;
    for (const Moment* m = h.past; m < h.past + h.kept; m++)
        if (m->ns > ns) {
            if (m->force == 0) return count;
            count++;
        }
    return -1;
}

// Likewise from the tick of the last fault on.
int64_t stand_in_ticks_with_force_since_fault() {
    Hand& h = hand();
    Hold hold(h);
    int64_t count = 0;
    for (const Moment* m = h.past; m < h.past + h.kept; m++)
        if (h.fault_tick >= 0 && m->tick >= h.fault_tick) {
            if (m->force == 0) return count;
            count++;
        }
    return -1;
}

void stand_in_reset() {
    Hand& h = hand();
    Hold hold(h);
    memset(h.asked, 0, sizeof h.asked);
    h.target[0] = h.target[1] = h.position[0] = h.position[1] = 0;
    h.target[2] = h.position[2] = 5;
    h.ticks = h.misuse = h.closed = 0;
    h.fault_tick = -1;
    h.buttons = h.bounces = 0;
    h.unplugged = h.absurd = h.overrun = h.refuses = h.absent = h.warm = h.snaps = h.enabled = false;
    h.late = 0;
    h.kept = 0;
}
}
