#pragma once
// What the loop and a device say to each other: commands of all tools in, a force for each tool out. Implemented by
// Pointer, Replay and haptics/ServoDevice; called by RealtimeLoop, on the loop's thread.
#include "tissue/tissue_model.h"
#include <cstdint>

namespace palpate {

constexpr int most_tools = TissueModel::max_patches; // at work in a loop at once

enum class CommandKind : uint8_t {
    away,   // the tool is not there
    hold,   // it holds the tissue at a point of the surface at rest and displaces it
    needle, // it enters at a point of the surface at rest; its tip is to be `displacement` from there
    free,   // its tip is at a point in space; contact follows from that
    blade,  // it cuts along the surface towards a point there; `displacement` is its edge, from there into the tissue
    carry   // it holds a loose piece at a point of it, where that came free, and moves it by `displacement` from there
};

// What a user wants of one tool. Complete in itself: only the newest command counts, older ones may be lost.
struct Command {
    CommandKind kind = CommandKind::away;
    double point[3] = {0, 0, 0};        // mm
    double displacement[3] = {0, 0, 0}; // mm
};

struct Commands {
    int64_t serial = 0; // the device's own count, returned with the frame that first obeys it
    Command tool[most_tools];
};

// What a user feels of one tool.
struct Feedback {
    bool touching = false;
    double at[3] = {0, 0, 0};     // mm, the tool's tip
    double force[3] = {0, 0, 0};  // N, of the tissue on the tool, within SimulationSettings::limit
    double stiffness = 0;         // N/mm, slope of the force along the displacement, in a tick; else force over way
    double anchor[3] = {0, 0, 0}; // mm, the contact on the surface at rest
    double normal[3] = {0, 0, 0}; // outward normal of a contact that can only push; zero: it may also pull
    double out[3] = {0, 0, 0};    // outward normal of the surface there, while it touches
};

// From `tick` on, answers lack tables (ModelState::stale). Bit 0: the current model; bit 1: the one being blended in.
// Bits 2 and 3, 4 and 5: their ModelState::events.
struct TableEvent {
    static constexpr int recorded = 64; // set if all this comes from a recording
    int64_t tick = 0;
    int missing_tables = 0;
};

class Device {
public:
    virtual ~Device() = default;
    // Both return at once: they neither wait nor allocate.
    virtual const Commands& read_commands(int64_t tick) = 0;
    virtual void write_feedback(const Feedback* feedback) = 0; // of all most_tools tools
    virtual int missing_tables(int64_t) { return 0; }          // at a tick of a recording: TableEvent::missing_tables
};

} // namespace palpate
