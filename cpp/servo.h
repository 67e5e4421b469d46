#pragma once
#include "latest.h"
#include <cstdint>
#include <limits>

namespace palpate {

struct Pose {                       // what a device says, written by the servo, read by the solver loop
    int64_t serial = 0;             // rises with each reading
    double position[3] = {0, 0, 0}; // mm, world, of the tool's tip: behind the coupling, so in the tissue itself
    double hand[3] = {0, 0, 0};     // mm, world, of the device's own tip: before the coupling
    uint8_t buttons = 0;            // bit 0: the grip/stylus button
    bool present = false;           // false: not ready, lost or faulted
};

struct Local {          // the solver's answer, written by the solver loop, read by the servo
    int64_t serial = 0; // rises with each answer
    bool touching = false;
    double at[3] = {0, 0, 0};                          // mm, the tool position for which `force` holds
    double force[3] = {0, 0, 0};                       // N, of the tissue on the tool
    double stiffness[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0}; // N/mm, symmetric: force(x) = force - stiffness (x - at)
    double normal[3] = {0, 0, 0}; // unit, out of the tissue: it only pushes that way; zero: it may pull (a grasp)
};

// Why the force is zero. All but the last three pass by themselves; the force then rises from zero again.
enum class Fault : int {
    none,
    waiting,  // the solver has not answered yet
    stalled,  // nor lately
    answer,   // it answered what is no number, or a stiffness that no tissue has
    position, // the device says where no hand can be: no number, or far outside its workspace
    jump,     // or it got there faster than any hand
    late,     // the device's callback stayed away too long
    overrun,  // the device's driver says that a tick took too long
    force,    // the device refused the force: too much, too fast, motors too warm
    off,      // nobody runs the device
    lost,     // the device does not answer any more: unplugged, switched off
    device    // the device says that it is broken
};
const char* name(Fault fault);
const char* text(Fault fault); // a sentence: what happened and what to do

struct ServoSettings {
    double period = 1e-3;       // s, between ticks
    double force = 3;           // N, the most that the device is given
    double stiffness = 0.5;     // N/mm, the most that the device can show without buzzing
    double damping = 5e-4;      // N s/mm, of the coupling
    double most_damping = 5e-3; // N s/mm, the most that the passivity controller adds
    double debt = 1;            // mJ, energy given out from which on the force fades; at twice that it is zero
    double lowest[3] = {-1e3, -1e3, -1e3}, highest[3] = {1e3, 1e3, 1e3}; // mm, device frame: the workspace
    double scale = 1;                                                    // world mm a device mm
    double rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};                    // world = offset + scale rotation device
    double offset[3] = {0, 0, 0};
    double fastest = 5e3; // mm/s, device frame
    double ramp = 0.5;    // s, of the force from nothing to all
    double blend = 3e-3;  // s, from one answer to the next
    double stale = 8e-3;  // s, the age at which an answer, or a tick, is too old
    double settle = 0.1;  // s, that all must be well after a fault before the force rises again
    double bounce = 0.02; // s, that a button must keep still to be believed
};

struct ServoStatus { // for display
    int64_t ticks = 0, late = 0, answers = 0, faults = 0;
    double period = 0, worst = 0;   // s, between ticks: the last one and the longest
    double energy = 0;              // mJ, taken from the hand in this contact; below 0: given to it
    double damping = 0;             // N s/mm, that the passivity controller adds now
    double gain = 0;                // 0 to 1, the ramp
    double force[3] = {0, 0, 0};    // N, world, on the hand
    double position[3] = {0, 0, 0}; // mm, world, of the hand
    Fault fault = Fault::waiting;
    Fault last = Fault::none; // the newest one that was not mere waiting
    bool zeroed = true;
};

// What runs at a device's own rate, in whatever thread the device gives: a reading in, a force out. Takes no lock,
// allocates nothing, never waits. The solver's newest answer is a local model of the contact, good between answers;
// the hand is tied to the tool by a damped spring no stiffer than the device bears (virtual coupling: Colgate, Stanley
// & Brown 1995), solved implicitly so that neither a stiff tissue nor a slow tick makes it ring. A time-domain
// passivity observer and controller (Hannaford & Ryu 2002) then sees to it that the hand is given no net energy.
class Servo {
public:
    explicit Servo(const ServoSettings& settings = {}); // throws std::invalid_argument on settings that cannot be

    // One reading (mm, device frame) in, one force (N, device frame) out. now_ns: of a clock that never goes back.
    void tick(const double position_mm[3], uint8_t buttons, int64_t now_ns, double force[3]);
    void trip(Fault fault);               // zero from now on; passes when all has been well for `settle`
    void lose(Fault fault = Fault::lost); // the device is gone or in fault: zero until a new start
    void restart();                       // the device is back
    // The last three: from the thread that ticks, or while none does.

    Latest<Pose> poses;
    Latest<Local> answers;
    Latest<ServoStatus> status;
    const ServoSettings settings;

private:
    struct Affine { // force(x) = constant - stiffness x
        double constant[3] = {0, 0, 0}, stiffness[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0};
        bool touching = false;
    };
    Affine from, to;   // the answers being blended
    double weight = 1; // of `to`
    double normal[3] = {0, 0, 0};
    double slack[3] = {0, 0, 0};   // hand - tool, mm, world
    double reading[3] = {0, 0, 0}; // the last one, device frame
    double given[3] = {0, 0, 0};   // the last force, device frame
    bool read = false, gone = false;
    int64_t serial = 0, answered = 0; // of the newest answer; ns, when it came
    int64_t now = 0, tripped = 0, began = 0;
    int64_t still[8] = {0, 0, 0, 0, 0, 0, 0, 0}; // ns, since when each raw button has kept its state
    uint8_t raw = 0, buttons = 0;
    Fault fault = Fault::waiting;
    ServoStatus shown;
    Pose pose;

    double advance(int64_t now_ns);
    bool plausible(const double position[3], double h, double moved[3]);
    void debounce(uint8_t bits);
    void listen();
    void recover();
    void observe(const double moved[3], double h);
    void couple(const double hand[3], double h, double force[3]);
    void keep_passive(const double moved[3], double h, double force[3]);
    void publish(const double hand[3], const double force[3]);
};

} // namespace palpate
