#pragma once
// A recording as a device: each command counts from its tick on, whatever the clock says. On the loop's thread.
#include "simulation/device.h"
#include <vector>

namespace palpate {

class Replay : public Device {
    const std::vector<int64_t> ticks; // not decreasing
    const std::vector<uint8_t> tools;
    const std::vector<Command> commands;
    const std::vector<TableEvent> table_events; // increasing
    const int recorded;                         // TableEvent::recorded, or 0 where only the commands are given
    Commands now;
    size_t next = 0, next_event = 0;

public:
    Replay(std::vector<int64_t> ticks, std::vector<uint8_t> tools, std::vector<Command> commands,
           std::vector<TableEvent> table_events = {}, bool recorded = false)
        : ticks(std::move(ticks)), tools(std::move(tools)), commands(std::move(commands)),
          table_events(std::move(table_events)), recorded(recorded ? TableEvent::recorded : 0) {}
    int missing_tables(int64_t tick) override {
        while (next_event < table_events.size() && table_events[next_event].tick <= tick) next_event++;
        return recorded | (next_event ? table_events[next_event - 1].missing_tables : 0);
    }
    const Commands& read_commands(int64_t tick) override {
        for (; next < ticks.size() && ticks[next] <= tick; next++) now.tool[tools[next]] = commands[next];
        return now;
    }
    void write_feedback(const Feedback*) override {}
};

} // namespace palpate
