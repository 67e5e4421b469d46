#include "spring.h"
#include "clock.h"
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace palpate {

Spring::Spring(Servo& servo, double stiffness, const double from[3], const double out[3], double told, int delay)
    : servo(servo), stiffness(stiffness), told(told), past(size_t(std::max(0, delay)) + 1) {
    std::copy_n(from, 3, point);
    std::copy_n(out, 3, normal);
}

void Spring::answer() {
    past[next] = servo.poses.reading();
    next = (next + 1) % past.size();
    const Pose& pose = past[next]; // the oldest kept
    if (Way(way.load()) == Way::stalled) return;
    Local& local = servo.answers.writing();
    double depth = 0;
    for (int k = 0; k < 3; k++) depth += (point[k] - pose.position[k]) * normal[k];
    local = Local();
    local.serial = ++answered;
    local.touching = pose.present && depth > 0;
    for (int i = 0; i < 3; i++) {
        local.at[i] = pose.position[i];
        local.normal[i] = normal[i];
        if (local.touching) local.force[i] = stiffness * depth * normal[i];
        for (int j = 0; j < 3; j++) local.stiffness[3 * i + j] = told * stiffness * normal[i] * normal[j];
    }
    if (Way(way.load()) == Way::nan) local.force[0] = NAN;
    last_ns = now_ns();
    servo.answers.publish();
}

void Spring::start(int rate) {
    if (thread.joinable()) throw std::logic_error("the spring runs already");
    stopping = false;
    thread = std::thread([this, rate] {
        for (Beat beat(rate); !stopping; beat.wait()) answer();
    });
}

void Spring::stop() {
    stopping = true;
    if (thread.joinable()) thread.join();
}

} // namespace palpate
