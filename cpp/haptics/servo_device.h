#pragma once
// A force-feedback device as the loop sees it: its tip is a tool in space, with its button down it holds what it
// touches, and with its second one down it is a blade there. Called on the loop's thread; the servo runs in the
// device's.
#include "haptics/servo.h"
#include "simulation/device.h"
#include <algorithm>
#include <atomic>

namespace palpate {

class ServoDevice : public Device {
    Servo& servo;
    Commands now;
    Feedback last;
    int64_t answers = 0;
    double out[3] = {0, 0, 1}; // of the surface where its blade went in

public:
    std::atomic<double> edge{0}; // mm that its blade is deep; 0: it has none
    bool withdrawn = false;      // the answers' LocalContactModel::withdrawn; on the loop's thread

    explicit ServoDevice(Servo& servo) : servo(servo) {}

    const Commands& read_commands(int64_t) override {
        const DevicePose& pose = servo.poses.latest();
        Command& tool = now.tool[0];
        now.serial = pose.serial;
        const double deep = edge.load(std::memory_order_relaxed);
        const bool cuts =
            pose.present && (pose.buttons & 2) && deep > 0 && (last.touching || tool.kind == CommandKind::blade);
        const bool holds =
            !cuts && pose.present && (pose.buttons & 1) && (last.touching || tool.kind == CommandKind::hold);
        if (holds && tool.kind != CommandKind::hold) std::copy_n(last.anchor, 3, tool.point);
        if (cuts && tool.kind != CommandKind::blade) std::copy_n(last.out, 3, out);
        tool.kind = cuts           ? CommandKind::blade
                    : holds        ? CommandKind::hold
                    : pose.present ? CommandKind::free
                                   : CommandKind::away;
        for (int k = 0; k < 3; k++) {
            if (!holds) tool.point[k] = pose.position[k];
            tool.displacement[k] = holds ? pose.position[k] - tool.point[k] : cuts ? -deep * out[k] : 0;
        }
        return now;
    }

    void write_feedback(const Feedback* feedback) override {
        last = feedback[0];
        LocalContactModel& local = servo.answers.write_slot();
        local = LocalContactModel();
        local.serial = ++answers;
        local.touching = last.touching;
        local.withdrawn = withdrawn;
        for (int k = 0; k < 3; k++) {
            local.at[k] = last.at[k];
            local.force[k] = last.force[k];
            local.normal[k] = last.normal[k];
            local.stiffness[4 * k] = last.stiffness;
        }
        servo.answers.publish();
    }
};

} // namespace palpate
