#pragma once
#include "contact.h"
#include "device.h"
#include "vector.h"
#include <type_traits>

namespace palpate {

// How a tool may move. A pointer sends some 60 commands a second and the loop runs 1000 ticks: between commands the
// tool glides, so that the force has no steps; the gliding counts ticks, never the clock, so that a record replays
// exactly.
struct Pace {
    double approach = 0.08; // the part of the way to the command that a tick covers: 12 ms to be 63 % there
    double reach = 1.0;     // mm a tick at most, along the surface and in displacement: 1 m/s
};

// What a needle meets, in the three parts of A. M. Okamura, C. Simone & M. D. O'Leary, IEEE Trans. Biomed. Eng. 51
// (2004) 1707: the tissue's stiffness until it is pierced, then cutting at the tip and friction along the shaft.
struct NeedleForces {
    double puncture = 0.6;  // N, at which the surface is pierced
    double cutting = 0.3;   // N, at the tip
    double friction = 0.02; // N a mm of shaft inside
};

struct Manner {            // of all tools
    double radius = 5;     // of the contact, mm
    double friction = 0.3; // Coulomb's, of tools in space
    Pace pace;
    NeedleForces needle;
};

// Where a tool really is: the contact in force, following the commands (Zilles & Salisbury 1995 call it the
// god-object).
struct Proxy {
    enum class Grip : uint8_t {
        idle,
        holding,
        refused, // until let go (held still there, or a command that is no number)
        open     // it feels where the tissue is, but does not hold it: about to hold, or in space
    };
    Grip grip = Grip::idle;
    Command::Kind kind = Command::Kind::away;
    Hit at;                                // on the surface at rest
    double displacement[3] = {0, 0, 0};    // of the patch's weighted mean, mm
    double force[3] = {0, 0, 0};           // N, of the tissue on the tool: the last answer
    double slope[3] = {0, 0, 0};           // N, what the tissue's energy rises by a mm that the contact slides
    double lure[3] = {0, 0, 0};            // N, that slope as a tool in space follows it
    double rest[3] = {0, 0, 0};            // mm, where the tissue had gone when a tool in space met it
    double risen[2] = {0, 0};              // mm N and N^2, summed over its first ticks
    double give = 0;                       // mm that it slides for a newton
    int fresh = 0;                         // ticks until that is known
    double toll[3] = {0, 0, 0};            // of |force|, on the tool, that makes a sliding hand pay for that
    double heading[3] = {0, 0, 0};         // mm, its way of late: where it slides to
    double gone = 0;                       // mm, that way as it went, to and fro
    double brake[3] = {0, 0, 0};           // of |force|, on the tool, while the hand has got more than it gave
    double tip[3] = {0, 0, 0};             // mm, of the tool, in space
    double way[3] = {0, 0, 0};             // mm, a needle's tip from where it entered
    double axis[3] = {0, 0, 0};            // of a needle that has pierced the surface
    double inside = 0;                     // mm of it that are in the tissue
    bool pierced = false, outside = false; // outside: a tool in space was seen out of the tissue
    int64_t landed = 0;                    // tick at which it took hold
    Patch patch;
    void total(double out[3]) const { // N, on the tool
        const double size = length(force);
        for (int k = 0; k < 3; k++) out[k] = force[k] + size * (toll[k] + brake[k]);
    }
    void owe_nothing() { // for the way of late
        gone = 0;
        for (int k = 0; k < 3; k++) toll[k] = heading[k] = 0;
    }
};

// The loop copies proxies to look ahead: nothing in them may allocate.
static_assert(std::is_trivially_copyable_v<Proxy>);

// One tick of one tool: takes hold, glides towards the command, slips, pierces, or lets go. others: whether another
// tool holds the tissue. known: whether the last answer was to be trusted.
void follow(Proxy& proxy, const Command& command, const Surface& surface, const Manner& manner, bool others, bool known,
            SurfaceScratch& scratch);

} // namespace palpate
