#pragma once
#include "latest.h"
#include "model.h"
#include <cstdint>
#include <vector>

namespace palpate {

// What a hand wants of one tool. Complete in itself: the newest command says all, older ones may be lost.
struct Command {
    enum class Kind : uint8_t {
        away,
        hold,   // the tissue at a point of its surface at rest, to be displaced
        needle, // in at a point of the surface at rest, its tip to be `displacement` from there
        free    // its tip is at a point in space; what it touches follows from that
    };
    Kind kind = Kind::away;
    double point[3] = {0, 0, 0};        // mm
    double displacement[3] = {0, 0, 0}; // mm
};

// From a tick on answers lack tables (State::cold): bit 0 of the model at work, bit 1 of the one that comes.
struct Switch {
    int64_t tick = 0;
    int lacking = 0;
};

struct Commands {
    int64_t serial = 0; // the device's own count, handed back with the frame that first obeys it
    Command tool[most_tools];
};

// What a hand feels of one tool.
struct Felt {
    bool touching = false;
    double at[3] = {0, 0, 0};     // mm, where the tool's tip is
    double force[3] = {0, 0, 0};  // N, of the tissue on the tool, limited to what the device can bear
    double stiffness = 0;         // N/mm, about what it rises by when pressed further
    double anchor[3] = {0, 0, 0}; // mm, on the surface at rest, where it touches
    double normal[3] = {0, 0, 0}; // out of the tissue, which only pushes that way; zero: it may pull
};

// The other end of the loop: hands, or a record of them. All calls come from the loop's thread and return at once.
class Device {
public:
    virtual ~Device() = default;
    virtual const Commands& probe(int64_t tick) = 0;
    virtual void push(const Felt* felt) = 0;   // of all most_tools
    virtual int lacking(int64_t) { return 0; } // tables of a record's tick: Switch::lacking
};

// Pointers in a page: another thread writes commands, the newest wins. They feel nothing; the page draws the force.
class Pointer : public Device {
    Latest<Commands> newest;
    Commands all;

public:
    void send(int tool, const Command& command, int64_t serial) {
        all.serial = serial;
        all.tool[tool] = command;
        newest.writing() = all;
        newest.publish();
    }
    const Commands& probe(int64_t) override { return newest.reading(); }
    void push(const Felt*) override {}
};

// A record: each command is obeyed from its tick on, whatever the clock says.
class Replay : public Device {
    const std::vector<int64_t> ticks; // not falling
    const std::vector<uint8_t> tools;
    const std::vector<Command> commands;
    const std::vector<Switch> switches; // rising
    Commands now;
    size_t next = 0, switched = 0;

public:
    Replay(std::vector<int64_t> ticks, std::vector<uint8_t> tools, std::vector<Command> commands,
           std::vector<Switch> switches = {})
        : ticks(std::move(ticks)), tools(std::move(tools)), commands(std::move(commands)),
          switches(std::move(switches)) {}
    int lacking(int64_t tick) override {
        while (switched < switches.size() && switches[switched].tick <= tick) switched++;
        return switched ? switches[switched - 1].lacking : 0;
    }
    const Commands& probe(int64_t tick) override {
        for (; next < ticks.size() && ticks[next] <= tick; next++) now.tool[tools[next]] = commands[next];
        return now;
    }
    void push(const Felt*) override {}
};

} // namespace palpate
