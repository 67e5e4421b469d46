#include "simulation.h"
#include "vector.h"
#include <algorithm>
#include <cmath>

// That no hand gets more than it gave: what sliding costs is learnt and charged, and what that misses is taken back.
namespace palpate {
namespace {

using Grip = Proxy::Grip;
constexpr double heading = 0.1;      // of the radius: the way over which a hand's direction is taken
constexpr double sure = 0.5;         // of that way, in one direction: then what is due is asked in full
constexpr double tolling = 0.2;      // of the way to what is due, a tick
constexpr double gentle = 5e-3;      // of the force, a tick: a change of it that no hand notices
constexpr double most_brake = 0.1;   // of the force
constexpr double least_slide = 0.01; // mm a tick: slower, a slope is learnt over several ticks

// Towards `wanted`, no further than `most`.
void move(double from[3], const double wanted[3], double most) {
    const double change[3] = {wanted[0] - from[0], wanted[1] - from[1], wanted[2] - from[2]};
    const double far = length(change), part = far > most ? most / far : 1;
    for (int k = 0; k < 3; k++) from[k] += part * change[k];
}

} // namespace

// From tick to tick the tissue's energy grows by what the displacements cost, -f.du, and by slope.dp of the contact's
// way dp: so the slope is learnt along each way gone (the least change that explains the last tick; C. G. Broyden,
// Math. Comput. 19 (1965) 577).
void Simulation::learn_slopes() {
    const double stored = now.model->energy(*now.state, closed, moved, force);
    double unexplained = stored - energy, square = 0, way[most_tools][3] = {};
    bool same = true;
    for (int t = 0; t < most_tools; t++) {
        Proxy& p = proxy[t];
        const Past& was = past[t];
        const bool holds = p.grip == Grip::holding;
        same = same && holds == was.held;
        if (!holds || !was.held) continue;
        for (int k = 0; k < 3; k++) {
            way[t][k] = p.at.point[k] - was.point[k];
            unexplained += 0.5 * (p.force[k] + was.force[k]) * (p.displacement[k] - was.displacement[k]);
            unexplained -= p.slope[k] * way[t][k];
        }
        square += dot(way[t], way[t]);
    }
    energy = stored;
    if (!same || square == 0 || next.model || now.state->fading || !std::isfinite(unexplained)) return;
    const double step = unexplained / (square + least_slide * least_slide);
    for (int t = 0; t < most_tools; t++) {
        if (!past[t].held || dot(way[t], way[t]) == 0) continue;
        Proxy& p = proxy[t];
        for (int k = 0; k < 3; k++) p.slope[k] += step * way[t][k];
        const double steep = length(p.slope), most = length(p.force);
        if (steep > most)
            for (double& x : p.slope) x *= most / steep;
        if (p.kind == Command::Kind::hold) charge(p, way[t], freely(p, past[t]));
    }
}

// What is charged may change, a tick, by as much as the tissue's own answer does, and a little more: a hand that turns
// in a slow stroke feels no step, and one that flicks, whose force changes anyway, still pays in time.
double Simulation::freely(const Proxy& p, const Past& was) const {
    if (!was.held || now.state->fading) return gentle;
    const double change[3] = {p.force[0] - was.force[0], p.force[1] - was.force[1], p.force[2] - was.force[2]};
    return gentle + length(change) / std::max(length(p.force), 1e-12);
}

// The tissue's energy rises where a contact slides to a stiffer place, and a hand has to pay for it: else a loop that
// slides to where it is stiff and lets go there would give work away. A hand that slides its hold along d does -F.d of
// work a mm, of which the tissue takes slope.d: the force along d is never more than -slope.d, so that no way along the
// surface gives more than the tissue had. (A tool in space slides by itself, where that costs least, and pays nothing
// more.) d is where the hand has been heading over a part of the contact's radius: a pointer goes in steps of a pixel,
// now along a row, now aslant, and its force must not rattle with them. Where it turns the heading grows short, points
// anywhere and grows again, and the toll does so with it: like friction before it slides, which fades and comes the
// other way over a distance (P. R. Dahl, AIAA J. 14 (1976) 1675).
void Simulation::charge(Proxy& p, const double way[3], double most) const {
    const double step = length(way), kept = std::exp(-step / (heading * settings.manner.radius));
    for (int k = 0; k < 3; k++) p.heading[k] = kept * p.heading[k] + way[k];
    p.gone = kept * p.gone + step;
    const double far = std::max(length(p.heading), 1e-12), size = std::max(length(p.force), 1e-12);
    const double due = std::min(0.0, -(dot(p.slope, p.heading) + dot(p.force, p.heading)) / far);
    const double asked = due / size * std::min(1.0, far / (sure * p.gone)) / far;
    double wanted[3];
    for (int k = 0; k < 3; k++) wanted[k] = p.toll[k] + tolling * (asked * p.heading[k] - p.toll[k]);
    move(p.toll, wanted, most);
}

void Simulation::account() {
    double way[most_tools][3], most[most_tools];
    for (int t = 0; t < most_tools; t++) {
        const Proxy& p = proxy[t];
        Past& was = past[t];
        const bool holds = p.grip == Grip::holding;
        double total[3];
        p.total(total);
        for (int k = 0; k < 3; k++) {
            way[t][k] = holds && was.held ? p.tip[k] - was.tip[k] : 0;
            work -= 0.5 * (total[k] + was.total[k]) * way[t][k];
        }
        most[t] = freely(p, was);
        was.held = holds;
        std::copy_n(p.at.point, 3, was.point);
        std::copy_n(p.displacement, 3, was.displacement);
        std::copy_n(p.force, 3, was.force);
        std::copy_n(p.tip, 3, was.tip);
        std::copy_n(total, 3, was.total);
    }
    if (closed == 0) work_before = work - energy;
    brake(way, most);
}

// What the tissue holds beyond what the hands have put in since it was last untouched, the next ticks take back, as
// long as they move (B. Hannaford & J.-H. Ryu, IEEE Trans. Robot. Autom. 18 (2002) 1). It is what learning slopes has
// missed: little.
void Simulation::brake(const double way[most_tools][3], const double most[most_tools]) {
    double square = 0;
    for (int t = 0; t < most_tools; t++) square += dot(way[t], way[t]);
    const double unpaid = energy - (work - work_before), per = unpaid > 0 && square > 0 ? unpaid / (square + 1e-6) : 0;
    for (int t = 0; t < most_tools; t++) {
        Proxy& p = proxy[t];
        if (p.grip != Grip::holding) {
            std::fill_n(p.brake, 3, 0.0);
            continue;
        }
        const double share = per * length(way[t]) / std::max(length(p.force), 1e-12); // of the force
        const double part = -per / std::max(length(p.force), 1e-12) * (share > most_brake ? most_brake / share : 1);
        const double wanted[3] = {part * way[t][0], part * way[t][1], part * way[t][2]};
        move(p.brake, wanted, most[t]);
    }
}

} // namespace palpate
