// Passivity of the loop (B. Hannaford & J.-H. Ryu, IEEE Trans. Robot. Autom. 18 (2002) 1): the user must not get more
// energy out of the tissue than was put in. Two parts: the energy that sliding a contact costs is estimated and charged
// to the tool as drag; an observer counts the energy exchanged, and a controller dissipates what the drag has missed.
#include "base/vec3.h"
#include "simulation/simulation.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double drag_path = 0.1;    // of the contact's radius: length over which the direction of sliding is averaged
constexpr double straight = 0.5;     // of that length, in one direction: from there on the full drag is applied
constexpr double drag_filter = 0.2;  // low-pass filter of the drag, a tick
constexpr double slow_change = 5e-3; // of the force, a tick: too slow a change to be felt
constexpr double most_damping = 0.1; // of the force; a model that lags may give much away at once, and all is taken
constexpr double least_slide = 0.01; // mm a tick: below it a slope is learnt over several ticks

// Moves `from` towards `wanted`, by `most` at the most.
void move(double from[3], const double wanted[3], double most) {
    const double change[3] = {wanted[0] - from[0], wanted[1] - from[1], wanted[2] - from[2]};
    const double distance = length(change), part = distance > most ? most / distance : 1;
    for (int k = 0; k < 3; k++) from[k] += part * change[k];
}

} // namespace

// From tick to tick the tissue's energy grows by the work of the displacements, -f.du, and by slope.dp for a contact
// that slides by dp. The slope is updated along each dp: the least change that explains the last tick (C. G. Broyden,
// Math. Comput. 19 (1965) 577).
void Simulation::estimate_energy_slopes() {
    const double stored = now.model->energy(*now.state, closed, displaced, force);
    double unexplained = stored - energy - now.state->energy_shift, square = 0, way[most_tools][3] = {};
    bool same = true;
    for (int t = 0; t < most_tools; t++) {
        ToolProxy& p = proxy[t];
        const PreviousTick& before = previous[t];
        const bool closed_now = p.state == ContactState::closed;
        same = same && closed_now == before.closed;
        if (!closed_now || !before.closed) continue;
        for (int k = 0; k < 3; k++) {
            way[t][k] = p.at.point[k] - before.point[k];
            unexplained += 0.5 * (p.force[k] + before.force[k]) * (p.displacement[k] - before.displacement[k]);
            unexplained -= p.slope[k] * way[t][k];
        }
        square += dot(way[t], way[t]);
    }
    energy = stored;
    if (!same || square == 0 || next.model || now.state->blending || !std::isfinite(unexplained)) return;
    const double step = unexplained / (square + least_slide * least_slide);
    for (int t = 0; t < most_tools; t++) {
        if (!previous[t].closed || dot(way[t], way[t]) == 0) continue;
        ToolProxy& p = proxy[t];
        for (int k = 0; k < 3; k++) p.slope[k] += step * way[t][k];
        const double size = length(p.slope), most = length(p.force);
        if (size > most)
            for (double& x : p.slope) x *= most / size;
        if (p.kind == CommandKind::hold) update_drag(p, way[t], allowed_change(p, previous[t]));
    }
}

// How much drag and damping may change in a tick, over |force|: as much as the model's own force has changed, and a
// little more. So a slow stroke that turns round feels no step, and a fast one is still charged in time.
double Simulation::allowed_change(const ToolProxy& p, const PreviousTick& before) const {
    if (!before.closed || now.state->blending) return slow_change;
    const double change[3] = {p.force[0] - before.force[0], p.force[1] - before.force[1], p.force[2] - before.force[2]};
    return slow_change + length(change) / std::max(length(p.force), 1e-12);
}

// The tissue's energy rises where a contact slides to a stiffer place. Without a charge for it, a loop that slides to
// where the tissue is stiff and lets go there would extract energy. A held tool that slides along a unit vector d does
// the work -F.d for each mm, and the tissue takes slope.d: so the force along d is limited to -slope.d. (A tool in
// space slides by itself, where that costs least, and is not charged.) d is the average direction over a part of the
// contact's radius, because a pointer moves in steps of a pixel, along a row or across, and its force must not rattle
// with them. Where the tool turns, the average grows short, changes direction and grows again, and the drag with it, as
// friction does before it slides (P. R. Dahl, AIAA J. 14 (1976) 1675).
void Simulation::update_drag(ToolProxy& p, const double way[3], double most) const {
    const double step = length(way), kept = std::exp(-step / (drag_path * settings.tools.radius));
    for (int k = 0; k < 3; k++) p.slide_path[k] = kept * p.slide_path[k] + way[k];
    p.slide_length = kept * p.slide_length + step;
    const double distance = std::max(length(p.slide_path), 1e-12), size = std::max(length(p.force), 1e-12);
    const double limit = std::min(0.0, -(dot(p.slope, p.slide_path) + dot(p.force, p.slide_path)) / distance);
    const double wanted_part = limit / size * std::min(1.0, distance / (straight * p.slide_length)) / distance;
    double wanted[3];
    for (int k = 0; k < 3; k++) wanted[k] = p.drag[k] + drag_filter * (wanted_part * p.slide_path[k] - p.drag[k]);
    move(p.drag, wanted, most);
}

// Passivity observer: work of the tools on the tissue.
void Simulation::observe_energy() {
    double way[most_tools][3], most[most_tools];
    for (int t = 0; t < most_tools; t++) {
        const ToolProxy& p = proxy[t];
        PreviousTick& before = previous[t];
        const bool closed_now = p.state == ContactState::closed, cutting = p.state == ContactState::cutting;
        const bool carrying = p.state == ContactState::carrying;
        double total[3];
        p.total_force(total);
        for (int k = 0; k < 3; k++) {
            way[t][k] = closed_now && before.closed ? p.tip[k] - before.tip[k] : 0;
            const double done = -0.5 * (total[k] + before.total[k]) * way[t][k];
            work += done, recent_work += done;
            if ((cutting && before.cutting) || (carrying && before.carrying))
                work -= 0.5 * (total[k] + before.total[k]) * (p.tip[k] - before.tip[k]);
        }
        most[t] = allowed_change(p, before);
        before.closed = closed_now, before.cutting = cutting, before.carrying = carrying;
        std::copy_n(p.at.point, 3, before.point);
        std::copy_n(p.displacement, 3, before.displacement);
        std::copy_n(p.force, 3, before.force);
        std::copy_n(p.tip, 3, before.tip);
        std::copy_n(total, 3, before.total);
    }
    if (closed == 0) recent_work = energy; // a sum of its own, so that no bit of a force depends on earlier touches
    control_passivity(way, most);
}

// Passivity controller: energy that the tissue closed_now beyond what the tools have put in since it was last at rest
// is dissipated over the next ticks in which the tools move.
void Simulation::control_passivity(const double way[most_tools][3], const double most[most_tools]) {
    double square = 0;
    for (int t = 0; t < most_tools; t++) square += dot(way[t], way[t]);
    const double excess = energy - recent_work, per = excess > 0 && square > 0 ? excess / (square + 1e-6) : 0;
    for (int t = 0; t < most_tools; t++) {
        ToolProxy& p = proxy[t];
        if (p.state != ContactState::closed) {
            std::fill_n(p.damping, 3, 0.0);
            continue;
        }
        const double share = per * length(way[t]) / std::max(length(p.force), 1e-12); // of the force
        const double limit = now.state->lags ? 1 : most_damping;
        const double part = -per / std::max(length(p.force), 1e-12) * (share > limit ? limit / share : 1);
        const double wanted[3] = {part * way[t][0], part * way[t][1], part * way[t][2]};
        move(p.damping, wanted, most[t]);
    }
}

} // namespace palpate
