#include "proxy.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

using Grip = Proxy::Grip;
using Kind = Command::Kind;

// Of the way to the slope, a tick: a tool that slides at once by what it has just learnt from sliding overshoots,
// slides and sticks in turn, and from tick to tick doubles what rounding has begun.
constexpr double luring = 0.05;
constexpr int first_ticks = 20; // of a tool in space in touch, in which it feels what the tissue gives

bool finite(const Command& command) {
    double sum = 0;
    for (int k = 0; k < 3; k++) sum += command.point[k] + command.displacement[k];
    return std::isfinite(sum);
}

double apart(const double a[3], const double b[3]) {
    const double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return length(d);
}

void glide(double from[3], const double to[3], const Pace& pace) {
    double way = apart(from, to);
    double part = way * pace.approach > pace.reach ? pace.reach / way : pace.approach;
    if (way < 1e-6) part = 1; // mm: arrives, so that a still hand gives a still contact
    for (int k = 0; k < 3; k++) from[k] += part * (to[k] - from[k]);
}

// One tool of one tick, and what it may look at.
struct Step {
    Proxy& proxy;
    const Command& command;
    const Surface& surface;
    const Manner& manner;
    SurfaceScratch& scratch;

    bool find_patch() {
        if (surface.patch(proxy.at, manner.radius, scratch, proxy.patch) == Surface::Contact::good) return true;
        proxy.grip = Grip::refused;
        return false;
    }

    void move_to(const double point[3]) {
        const Hit before = proxy.at;
        proxy.at = surface.closest(point);
        if (apart(before.point, proxy.at.point) > 0) find_patch();
    }

    void hold() {
        if (apart(proxy.at.point, command.point) > 0) {
            double point[3];
            std::copy_n(proxy.at.point, 3, point);
            glide(point, command.point, manner.pace);
            move_to(point);
        }
        glide(proxy.displacement, command.displacement, manner.pace);
    }

    // In space: the tissue's surface is carried back to rest by what it has moved here, so that the one tree over the
    // surface at rest serves whatever the tissue does.
    void hover() {
        double point[3], out[3], gap = 0;
        for (int k = 0; k < 3; k++) point[k] = proxy.tip[k] - proxy.displacement[k];
        move_to(point);
        if (proxy.grip == Grip::refused) return;
        surface.normal(proxy.at, out);
        for (int k = 0; k < 3; k++) gap += (point[k] - proxy.at.point[k]) * out[k];
        if (gap >= 0) {
            proxy.outside = true;
        } else if (proxy.outside) { // a tool that begins inside holds nothing until it has come out
            proxy.grip = Grip::holding;
            std::fill_n(proxy.slope, 3, 0.0);
            std::fill_n(proxy.lure, 3, 0.0);
            std::copy_n(proxy.displacement, 3, proxy.rest);
            std::fill_n(proxy.risen, 2, 0.0);
            proxy.fresh = first_ticks;
        }
    }

    // What the tissue gives where it is touched: the way over the force. Beside other tools, that move the tissue too,
    // this grows without end as the force fades, and would fling the contact about: so it is no more than it was as the
    // force first rose, and for each radius slid e times that, since places differ.
    void learn_give(double way, double force) {
        if (proxy.fresh > 0) {
            proxy.fresh--;
            proxy.risen[0] += apart(proxy.displacement, proxy.rest) * force, proxy.risen[1] += force * force;
            proxy.give = proxy.risen[0] / proxy.risen[1];
        }
        proxy.give = proxy.give > 0 ? std::min(proxy.give, way / force) : way / force;
    }

    // In contact: stays where it touched until the force leaves Coulomb's cone, then follows along the surface as far
    // as brings it back; what drives it is the force and the energy that sliding would cost.
    void slip() {
        double out[3], across[3];
        surface.normal(proxy.at, out);
        const double press = dot(proxy.force, out), force = length(proxy.force), way = length(proxy.displacement);
        for (int k = 0; k < 3; k++) {
            proxy.lure[k] += luring * (proxy.slope[k] - proxy.lure[k]);
            across[k] = proxy.force[k] + proxy.lure[k];
        }
        const double along = dot(across, out);
        for (int k = 0; k < 3; k++) across[k] -= along * out[k];
        if (!(way > 1e-6) || !(force > 0)) return;
        learn_give(way, force);
        const double excess = length(across) - manner.friction * press;
        if (!(excess > 0)) return;
        const double slid = std::min(excess * proxy.give, manner.pace.reach), step = slid / length(across);
        double point[3];
        for (int k = 0; k < 3; k++) point[k] = proxy.at.point[k] - step * across[k];
        move_to(point);
        proxy.give *= std::exp(slid / manner.radius);
    }

    void go_free() {
        const double most = 5 * manner.pace.reach, way = apart(proxy.tip, command.point);
        for (int k = 0; k < 3; k++) proxy.tip[k] += (way > most ? most / way : 1) * (command.point[k] - proxy.tip[k]);
        if (proxy.grip == Grip::holding) slip();
        if (proxy.grip == Grip::open) hover();
        if (proxy.grip == Grip::holding)
            for (int k = 0; k < 3; k++) proxy.displacement[k] = proxy.tip[k] - proxy.at.point[k];
    }

    // The tip on the surface: it dents the tissue from where that is, and never pulls it.
    void dent() {
        double out[3];
        surface.normal(proxy.at, out);
        glide(proxy.way, command.displacement, manner.pace);
        const double way = length(proxy.way), level = proxy.grip == Grip::open ? dot(proxy.displacement, out) : 0;
        if (proxy.grip == Grip::holding && dot(proxy.force, out) < 0) proxy.grip = Grip::open;
        if (proxy.grip == Grip::open && !(dot(proxy.way, out) < level)) return;
        proxy.grip = Grip::holding;
        std::copy_n(proxy.way, 3, proxy.displacement);
        if (way < 1e-3 || -dot(proxy.force, proxy.way) / way < manner.needle.puncture) return;
        proxy.pierced = true;
        for (int k = 0; k < 3; k++) proxy.axis[k] = proxy.way[k] / way;
    }

    // The tissue at the entry goes with the shaft until cutting and friction give way.
    void drive() {
        glide(proxy.way, command.displacement, manner.pace);
        const double deep = dot(proxy.way, proxy.axis), push = -dot(proxy.force, proxy.axis);
        const double with = dot(proxy.displacement, proxy.axis), stiffness = std::abs(with) > 1e-6 ? push / with : 0;
        const double rub = manner.needle.friction * proxy.inside, in = push - manner.needle.cutting - rub;
        if (stiffness > 0 && in > 0) proxy.inside += in / stiffness;
        if (stiffness > 0 && push < -rub) proxy.inside = std::max(0.0, proxy.inside - (-push - rub) / stiffness);
        if (proxy.inside == 0 && deep < 0) { // out again
            proxy.pierced = false;
            proxy.grip = Grip::open;
            return;
        }
        for (int k = 0; k < 3; k++) proxy.displacement[k] = (deep - proxy.inside) * proxy.axis[k];
    }

    void take(bool others) {
        const bool space = command.kind == Kind::free;
        proxy = Proxy();
        proxy.kind = command.kind;
        proxy.at = surface.closest(command.point);
        std::copy_n(command.point, 3, proxy.tip);
        proxy.grip = others || command.kind != Kind::hold ? Grip::open : Grip::holding;
        if (find_patch() && space) hover();
    }
};

} // namespace

void follow(Proxy& proxy, const Command& command, const Surface& surface, const Manner& manner, bool others, bool known,
            SurfaceScratch& scratch) {
    const bool open_hand = command.kind == Kind::free && proxy.kind == Kind::hold;
    const bool grasping = command.kind == Kind::hold && proxy.kind == Kind::free;
    if (proxy.grip == Grip::holding && (open_hand || grasping)) { // a hand closes or opens where it touches
        proxy.kind = command.kind;
        proxy.outside = true;
        std::fill_n(proxy.lure, 3, 0.0);
        proxy.give = 0;
        proxy.owe_nothing();
    }
    if (command.kind == Kind::away || command.kind != proxy.kind) {
        const bool refused = proxy.grip == Grip::refused && command.kind != Kind::away;
        proxy.kind = command.kind;
        if (!refused) proxy.grip = Grip::idle;
        std::fill_n(proxy.force, 3, 0.0);
        std::fill_n(proxy.slope, 3, 0.0);
        proxy.owe_nothing();
        std::fill_n(proxy.brake, 3, 0.0);
        if (command.kind == Kind::away) return;
    }
    if (proxy.grip == Grip::refused) return;
    if (!finite(command)) {
        proxy.grip = Grip::refused;
        return;
    }
    Step step{proxy, command, surface, manner, scratch};
    if (proxy.grip == Grip::idle) {
        step.take(others);
        if (proxy.grip != Grip::holding) return;
    }
    if (command.kind == Kind::free) return step.go_free();
    if (command.kind == Kind::needle) {
        proxy.pierced ? step.drive() : step.dent();
    } else {
        if (proxy.grip == Grip::open && !known) return; // beside another tool: from where the tissue has gone
        proxy.grip = Grip::holding;
        step.hold();
    }
    for (int k = 0; k < 3; k++)
        proxy.tip[k] = proxy.at.point[k] + (command.kind == Kind::needle ? proxy.way[k] : proxy.displacement[k]);
}

} // namespace palpate
