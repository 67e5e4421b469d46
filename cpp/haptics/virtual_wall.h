#pragma once
// A stand-in for the solver, for tests of servo and drivers without a tissue: a flat wall that pushes like a spring. It
// answers a servo's poses one by one or by the clock in a thread of its own, and can be made to fail.
#include "haptics/servo.h"
#include <atomic>
#include <thread>
#include <vector>

namespace palpate {

class VirtualWall {
public:
    enum class Mode { answers, stalls, nan };

    // stiffness: N/mm, along `normal` (unit, out of the wall) below `point` (mm). reported: the part of it that
    // the answers state as their stiffness. delay: answers by which it lags.
    VirtualWall(Servo& servo, double stiffness, const double point[3], const double normal[3], double reported,
                int delay);
    ~VirtualWall() { stop(); }

    void answer(); // to the newest pose; from one thread only
    void start(int rate);
    void stop();
    std::atomic<int> mode{0};                     // Mode
    std::atomic<int64_t> answered{0}, last_ns{0}; // answers so far, and when the last one came

private:
    Servo& servo;
    const double stiffness, reported;
    double point[3], normal[3];
    std::vector<DevicePose> poses; // ring buffer
    size_t next = 0;
    std::atomic<bool> stopping{false};
    std::thread thread;
};

} // namespace palpate
