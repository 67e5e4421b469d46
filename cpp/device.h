#pragma once
#include "latest.h"
#include <cstdint>
#include <vector>

namespace palpate {

// What a hand wants: hold the tissue at a point of its surface at rest and displace it. Complete in itself: the newest
// command says all, older ones may be lost.
struct Command {
    int64_t serial = 0; // the device's own count, handed back with the frame that first obeys it
    bool held = false;
    double point[3] = {0, 0, 0};        // mm, rest position
    double displacement[3] = {0, 0, 0}; // mm
};

// The other end of the loop: a hand, or a record of one. Both calls come from the loop's thread and return at once.
class Device {
public:
    virtual ~Device() = default;
    virtual const Command& probe(int64_t tick) = 0;
    virtual void push(const double force[3]) = 0; // N, already limited to what the device can bear
    virtual bool cold(int64_t) { return false; }  // a record's tick that was answered without tables (State::cold)
};

// A pointer in a page: another thread writes commands, the newest wins. It feels nothing; the page draws the force.
class Pointer : public Device {
    Latest<Command> newest;

public:
    void send(const Command& command) {
        newest.writing() = command;
        newest.publish();
    }
    const Command& probe(int64_t) override { return newest.reading(); }
    void push(const double*) override {}
};

// A record: each command is obeyed from its tick on, whatever the clock says.
class Replay : public Device {
    const std::vector<int64_t> ticks; // rising
    const std::vector<Command> commands;
    const Command idle;
    const std::vector<int64_t> switches; // ticks from which answers are cold, then not, then cold, ...
    size_t next = 0, switched = 0;

public:
    Replay(std::vector<int64_t> ticks, std::vector<Command> commands, std::vector<int64_t> switches = {})
        : ticks(std::move(ticks)), commands(std::move(commands)), switches(std::move(switches)) {}
    bool cold(int64_t tick) override {
        while (switched < switches.size() && switches[switched] <= tick) switched++;
        return switched % 2 == 1;
    }
    const Command& probe(int64_t tick) override {
        while (next < ticks.size() && ticks[next] <= tick) next++;
        return next ? commands[next - 1] : idle;
    }
    void push(const double*) override {}
};

} // namespace palpate
