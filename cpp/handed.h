#pragma once
#include "device.h"
#include "servo.h"
#include <algorithm>

namespace palpate {

// A device with motors as the loop's hand: its tip is a tool in space; with its button down it holds what it touches.
class Handed : public Device {
    Servo& servo;
    Commands now;
    Felt last;
    int64_t answers = 0;

public:
    explicit Handed(Servo& servo) : servo(servo) {}

    const Commands& probe(int64_t) override {
        const Pose& pose = servo.poses.reading();
        Command& tool = now.tool[0];
        now.serial = pose.serial;
        const bool grasps = pose.present && (pose.buttons & 1) && (last.touching || tool.kind == Command::Kind::hold);
        if (grasps && tool.kind != Command::Kind::hold) std::copy_n(last.anchor, 3, tool.point);
        tool.kind = grasps ? Command::Kind::hold : pose.present ? Command::Kind::free : Command::Kind::away;
        for (int k = 0; k < 3; k++) {
            if (!grasps) tool.point[k] = pose.position[k];
            tool.displacement[k] = grasps ? pose.position[k] - tool.point[k] : 0;
        }
        return now;
    }

    void push(const Felt* felt) override {
        last = felt[0];
        Local& local = servo.answers.writing();
        local = Local();
        local.serial = ++answers;
        local.touching = last.touching;
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
