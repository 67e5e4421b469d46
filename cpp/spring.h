#pragma once
#include "servo.h"
#include <atomic>
#include <thread>
#include <vector>

namespace palpate {

// A stand-in for the solver: a flat wall that pushes back like a spring. It answers a servo's poses, in a thread by the
// clock or one by one, and can be made to fail, so that servo and drivers are tested without a tissue.
class Spring {
public:
    enum class Way { well, stalled, nan }; // what it does when asked

    // stiffness: N/mm, along `normal` (unit, out of the wall) below `point` (mm). told: the part of it that the
    // answers admit. delay: answers by which it lags.
    Spring(Servo& servo, double stiffness, const double point[3], const double normal[3], double told, int delay);
    ~Spring() { stop(); }

    void answer(); // to the newest pose; from one thread only
    void start(int rate);
    void stop();
    std::atomic<int> way{0};
    std::atomic<int64_t> answered{0}, last_ns{0}; // answers so far, and when the last one came

private:
    Servo& servo;
    const double stiffness, told;
    double point[3], normal[3];
    std::vector<Pose> past; // a ring
    size_t next = 0;
    std::atomic<bool> stopping{false};
    std::thread thread;
};

} // namespace palpate
