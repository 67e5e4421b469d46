#pragma once
// Pointers of a web page as a device. Another thread (the server's) sends commands, the loop's thread reads the newest.
// They have no motors: the page draws the force.
#include "realtime/triple_buffer.h"
#include "simulation/device.h"

namespace palpate {

class Pointer : public Device {
    TripleBuffer<Commands> newest;
    Commands all; // the sender's

public:
    void send(int tool, const Command& command, int64_t serial) {
        all.serial = serial;
        all.tool[tool] = command;
        newest.write_slot() = all;
        newest.publish();
    }
    const Commands& read_commands(int64_t) override { return newest.latest(); }
    void write_feedback(const Feedback*) override {}
};

} // namespace palpate
