#include "haptics/virtual_wall.h"
#include "realtime/periodic_timer.h"
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace palpate {

VirtualWall::VirtualWall(Servo& servo, double stiffness, const double from[3], const double out[3], double reported,
                         int delay)
    : servo(servo), stiffness(stiffness), reported(reported), poses(size_t(std::max(0, delay)) + 1) {
    std::copy_n(from, 3, point);
    std::copy_n(out, 3, normal);
}

void VirtualWall::answer() {
    poses[next] = servo.poses.latest();
    next = (next + 1) % poses.size();
    const DevicePose& pose = poses[next]; // the oldest kept
    if (Mode(mode.load()) == Mode::stalls) return;
    LocalContactModel& local = servo.answers.write_slot();
    double depth = 0;
    for (int k = 0; k < 3; k++) depth += (point[k] - pose.position[k]) * normal[k];
    local = LocalContactModel();
    local.serial = ++answered;
    local.touching = pose.present && depth > 0;
    for (int i = 0; i < 3; i++) {
        local.at[i] = pose.position[i];
        local.normal[i] = normal[i];
        if (local.touching) local.force[i] = stiffness * depth * normal[i];
        for (int j = 0; j < 3; j++) local.stiffness[3 * i + j] = reported * stiffness * normal[i] * normal[j];
    }
    if (Mode(mode.load()) == Mode::nan) local.force[0] = NAN;
    last_ns = now_ns();
    servo.answers.publish();
}

void VirtualWall::start(int rate) {
    if (thread.joinable()) throw std::logic_error("the wall runs already");
    stopping = false;
    thread = std::thread([this, rate] {
        for (PeriodicTimer beat(rate); !stopping; beat.wait()) answer();
    });
}

void VirtualWall::stop() {
    stopping = true;
    if (thread.joinable()) thread.join();
}

} // namespace palpate
