#pragma once
// The servo of a force-feedback device: a position in, a force out, at the device's own rate and in the thread that the
// maker's driver gives. It takes no lock, allocates nothing and never waits. The solver's newest answer is a local
// model of the contact, valid between answers. The hand is connected to the tool by a damped spring no stiffer than the
// device can display (virtual coupling: J. E. Colgate, M. C. Stanley & J. M. Brown, Proc. IROS 1995), solved
// implicitly, so that neither a stiff tissue nor a late tick makes it unstable. A time-domain passivity observer and
// controller (B. Hannaford & J.-H. Ryu, IEEE Trans. Robot. Autom. 18 (2002) 1) then limits the energy that the hand is
// given.
#include "realtime/triple_buffer.h"
#include <cstdint>
#include <limits>

namespace palpate {

struct DevicePose {                 // the device's reading: written by the servo, read by the solver
    int64_t serial = 0;             // counts the readings
    double position[3] = {0, 0, 0}; // mm, world, of the tool behind the coupling, which touches the tissue
    double hand[3] = {0, 0, 0};     // mm, world, of the hand before the coupling
    uint8_t buttons = 0;            // bit 0: the grip/stylus button
    bool present = false;           // false: not ready, lost or faulted
};

struct LocalContactModel { // the solver's answer: written by the solver, read by the servo
    int64_t serial = 0;    // counts the answers
    bool touching = false;
    bool withdrawn = false;   // the force goes to zero within ServoSettings::withdrawal, and does not grow until then
    double at[3] = {0, 0, 0}; // mm, the tool position for which `force` holds
    double force[3] = {0, 0, 0};                       // N, of the tissue on the tool
    double stiffness[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0}; // N/mm, symmetric: force(x) = force - stiffness (x - at)
    double normal[3] = {0, 0, 0}; // outward unit normal of a contact that can only push; zero: it may also pull
};

// Why the force is zero. After all but the last three it returns by itself, rising from zero.
enum class Fault : int {
    none,
    waiting,  // the solver has not answered yet
    stalled,  // the solver has not answered for ServoSettings::max_age
    answer,   // its answer is not finite, or its stiffness is too far from positive definite
    position, // the device's position is not finite, or far outside its workspace
    jump,     // the position changed faster than any hand moves it
    late,     // the device's callback came too late
    overrun,  // the device's driver says that a tick took too long
    force,    // the device refused the force: too much, too fast, motors too warm
    off,      // nobody runs the device
    lost,     // the device does not answer any more: unplugged or switched off
    device    // the device reports a fault of its own
};
constexpr int fault_count = int(Fault::device) + 1;
const char* fault_name(Fault fault);
const char* fault_text(Fault fault); // a sentence: what happened and what to do

struct ServoSettings {
    double period = 1e-3;      // s, between ticks
    double force = 3;          // N, the largest force
    double stiffness = 0.5;    // N/mm, of the coupling: the largest that the device displays stably
    double damping = 5e-4;     // N s/mm, of the coupling
    double max_damping = 5e-3; // N s/mm, the largest that the passivity controller adds
    double energy_limit = 1;   // mJ given to the hand from which on the force fades; at twice that it is zero
    double lowest[3] = {-1e3, -1e3, -1e3},
           highest[3] = {1e3, 1e3, 1e3};              // mm, device frame: where positions are believed
    double scale = 1;                                 // mm of the world for a mm of the device
    double rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}; // world = offset + scale rotation device
    double offset[3] = {0, 0, 0};
    double max_speed = 5e3;   // mm/s, device frame
    double ramp = 0.5;        // s, in which the force rises from nothing
    double blend = 3e-3;      // s, from one answer to the next
    double withdrawal = 5e-3; // s, in which the force goes that an answer withdraws
    double max_age = 8e-3;    // s, the age at which an answer is too old, or a tick too late
    double recovery = 0.1;    // s without a fault before the force rises again
    double debounce = 0.02;   // s that a button must keep its state
};

struct ServoStatus { // for display
    int64_t ticks = 0, late = 0, answers = 0, faults = 0;
    double period = 0, worst = 0;   // s between ticks: the last and the longest
    double energy = 0;              // mJ, taken from the hand in this contact; negative: given to it
    double damping = 0;             // N s/mm, of the passivity controller now
    double gain = 0;                // 0 to 1, the ramp
    double force[3] = {0, 0, 0};    // N, world, on the hand
    double position[3] = {0, 0, 0}; // mm, world, of the hand
    Fault fault = Fault::waiting;
    Fault last = Fault::none; // the newest one but waiting
    bool zeroed = true;
};

class Servo {
public:
    explicit Servo(const ServoSettings& settings = {}); // throws std::invalid_argument

    // One position (mm, device frame) in, one force (N, device frame) out. now_ns: of a monotonic clock.
    void tick(const double position_mm[3], uint8_t buttons, int64_t now_ns, double force[3]);
    void trip(Fault fault);               // force zero until all has been well for ServoSettings::recovery
    void lose(Fault fault = Fault::lost); // the device is gone: force zero until restart()
    void restart();                       // the device is back
    // trip, lose, restart: from the thread that ticks, or while none does.

    TripleBuffer<DevicePose> poses;
    TripleBuffer<LocalContactModel> answers;
    TripleBuffer<ServoStatus> status;
    const ServoSettings settings;

private:
    struct Affine { // force(x) = constant - stiffness x
        double constant[3] = {0, 0, 0}, stiffness[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0};
        bool touching = false;
    };
    Affine from, to;   // the answers being blended
    double weight = 1; // of `to`, in the blend
    bool withdrawn = false;
    double withdrawn_from = 0; // N, the force when that began
    double normal[3] = {0, 0, 0};
    double stretch[3] = {0, 0, 0};    // mm, world, of the coupling: hand - tool
    double reading[3] = {0, 0, 0};    // the last one, device frame
    double last_force[3] = {0, 0, 0}; // device frame
    bool read = false, gone = false;
    int64_t serial = 0, answered = 0; // of the newest answer; ns, when it came
    int64_t now = 0, tripped = 0, began = 0;
    int64_t still[8] = {0, 0, 0, 0, 0, 0, 0, 0}; // ns, since when each raw button has its state
    uint8_t raw = 0, buttons = 0;
    Fault fault = Fault::waiting;
    ServoStatus shown;
    DevicePose pose;

    double begin_tick(int64_t now_ns);
    bool plausible(const double position[3], double h, double moved[3]);
    void debounce(uint8_t bits);
    void read_answer();
    void update_fault();
    void observe_energy(const double moved[3], double h);
    void solve_coupling(const double hand[3], double h, double force[3]);
    void control_passivity(const double moved[3], double h, double force[3]);
    void withdraw(double h, double force[3]);
    void publish(const double hand[3], const double force[3]);
};

} // namespace palpate
