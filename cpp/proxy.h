#pragma once
#include "contact.h"
#include "device.h"

namespace palpate {

// How a tool may move. A pointer sends some 60 commands a second and the loop runs 1000 ticks: between commands the
// tool glides, so that the force has no steps; the gliding counts ticks, never the clock, so that a record replays
// exactly.
struct Pace {
    double approach = 0.08; // the part of the way to the command that a tick covers: 12 ms to be 63 % there
    double reach = 1.0;     // mm a tick at most, along the surface and in displacement: 1 m/s
};

// Where the tool really is: the contact in force, following the commands (Zilles & Salisbury 1995 call it the
// god-object).
struct Proxy {
    enum class Grip {
        idle,
        holding,
        refused
    }; // refused: until let go (held still there, or a command that is no number)
    Grip grip = Grip::idle;
    Hit at;                             // on the surface at rest
    double displacement[3] = {0, 0, 0}; // of the patch's weighted mean, mm
    Patch patch;
};

// One tick: takes hold, glides towards the command, or lets go.
void follow(Proxy& proxy, const Command& command, const Surface& surface, double radius, const Pace& pace,
            SurfaceScratch& scratch);

} // namespace palpate
