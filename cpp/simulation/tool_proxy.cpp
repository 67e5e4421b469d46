#include "simulation/tool_proxy.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// Low-pass filter of the energy slope, a tick. Without it a tool that slides by the slope it has just learnt from
// sliding overshoots, sticks and slides in turn, and amplifies rounding from tick to tick.
constexpr double slope_filter = 0.05;
constexpr int first_ticks = 20; // of a contact, in which the compliance under a tool in space is estimated

// One tick of one tool.
struct ProxyUpdate {
    ToolProxy& proxy;
    const Command& command;
    const ContactSurface& surface;
    const ToolSettings& settings;
    SurfaceScratch& scratch;

    bool find_patch() { return palpate::find_patch(proxy, surface, settings, scratch); }

    void move_to(const double point[3]) {
        const SurfacePoint before = proxy.at;
        proxy.at = surface.closest(point);
        if (distance(before.point, proxy.at.point) > 0) find_patch();
    }

    void hold() {
        if (distance(proxy.at.point, command.point) > 0) {
            double point[3];
            std::copy_n(proxy.at.point, 3, point);
            approach(point, command.point, settings.motion);
            move_to(point);
        }
        approach(proxy.displacement, command.displacement, settings.motion);
    }

    // A tool in space: its tip is carried back by the tissue's displacement here and compared with the surface at rest,
    // so that one search tree serves every deformation. In the tick after it has let go that displacement is still the
    // tool's own, so that rounding alone would say on which side it is.
    void detect_contact() {
        double point[3], out[3], gap = 0;
        for (int k = 0; k < 3; k++) point[k] = proxy.tip[k] - proxy.displacement[k];
        move_to(point);
        if (proxy.state == ContactState::refused) return;
        surface.normal(proxy.at, out);
        for (int k = 0; k < 3; k++) gap += (point[k] - proxy.at.point[k]) * out[k];
        if (gap >= 0) {
            proxy.seen_outside = true;
        } else if (proxy.seen_outside && !proxy.released) { // a tool that starts inside has to go out first
            proxy.state = ContactState::closed;
            std::fill_n(proxy.slope, 3, 0.0);
            std::fill_n(proxy.filtered_slope, 3, 0.0);
            std::copy_n(proxy.displacement, 3, proxy.first_displacement);
            std::fill_n(proxy.compliance_sums, 2, 0.0);
            proxy.learning_ticks = first_ticks;
        }
    }

    // Compliance under the contact: displacement over force. Beside other tools, which move the tissue too, this ratio
    // grows without bound as the force fades and would throw the contact about. So it is limited to its estimate over
    // the first ticks; the limit grows by a factor e for each radius slid, since the compliance differs between places.
    void estimate_compliance(double way, double force) {
        if (proxy.learning_ticks > 0) {
            proxy.learning_ticks--;
            proxy.compliance_sums[0] += distance(proxy.displacement, proxy.first_displacement) * force,
                proxy.compliance_sums[1] += force * force;
            proxy.compliance = proxy.compliance_sums[0] / proxy.compliance_sums[1];
        }
        proxy.compliance = proxy.compliance > 0 ? std::min(proxy.compliance, way / force) : way / force;
    }

    // Stick and slip: the contact stays until the force leaves Coulomb's friction cone, then slides along the surface
    // as far as brings it back. The force and the slope of the energy drive it.
    void slide() {
        double out[3], across[3];
        surface.normal(proxy.at, out);
        const double press = dot(proxy.force, out), force = length(proxy.force), way = length(proxy.displacement);
        for (int k = 0; k < 3; k++) {
            proxy.filtered_slope[k] += slope_filter * (proxy.slope[k] - proxy.filtered_slope[k]);
            across[k] = proxy.force[k] + proxy.filtered_slope[k];
        }
        const double along = dot(across, out);
        for (int k = 0; k < 3; k++) across[k] -= along * out[k];
        if (!(way > 1e-6) || !(force > 0)) return;
        estimate_compliance(way, force);
        const double excess = length(across) - settings.friction * press;
        if (!(excess > 0)) return;
        const double slid = std::min(excess * proxy.compliance, settings.motion.reach), step = slid / length(across);
        double point[3];
        for (int k = 0; k < 3; k++) point[k] = proxy.at.point[k] - step * across[k];
        move_to(point);
        proxy.compliance *= std::exp(slid / settings.radius);
    }

    void follow_in_space() {
        const double most = 5 * settings.motion.reach, way = distance(proxy.tip, command.point);
        for (int k = 0; k < 3; k++) proxy.tip[k] += (way > most ? most / way : 1) * (command.point[k] - proxy.tip[k]);
        if (proxy.state == ContactState::closed) slide();
        if (proxy.state == ContactState::open) detect_contact();
        if (proxy.state == ContactState::closed)
            for (int k = 0; k < 3; k++) proxy.displacement[k] = proxy.tip[k] - proxy.at.point[k];
    }

    // Before puncture: the tip presses on the tissue, starting from where that has moved, and never pulls it.
    void press_needle() {
        double out[3];
        surface.normal(proxy.at, out);
        approach(proxy.way, command.displacement, settings.motion);
        const double way = length(proxy.way),
                     level = proxy.state == ContactState::open ? dot(proxy.displacement, out) : 0;
        if (proxy.state == ContactState::closed && dot(proxy.force, out) < 0) proxy.state = ContactState::open;
        if (proxy.state == ContactState::open && !(dot(proxy.way, out) < level)) return;
        proxy.state = ContactState::closed;
        std::copy_n(proxy.way, 3, proxy.displacement);
        if (way < 1e-3 || -dot(proxy.force, proxy.way) / way < settings.needle.puncture) return;
        proxy.pierced = true;
        for (int k = 0; k < 3; k++) proxy.axis[k] = proxy.way[k] / way;
    }

    // After puncture: the tissue at the entry moves with the shaft until the force exceeds cutting and friction.
    void insert_needle() {
        approach(proxy.way, command.displacement, settings.motion);
        const double deep = dot(proxy.way, proxy.axis), push = -dot(proxy.force, proxy.axis);
        const double with = dot(proxy.displacement, proxy.axis), stiffness = std::abs(with) > 1e-6 ? push / with : 0;
        const double friction = settings.needle.friction * proxy.insertion,
                     excess = push - settings.needle.cutting - friction;
        if (stiffness > 0 && excess > 0) proxy.insertion += excess / stiffness;
        if (stiffness > 0 && push < -friction)
            proxy.insertion = std::max(0.0, proxy.insertion - (-push - friction) / stiffness);
        if (proxy.insertion == 0 && deep < 0) { // out again
            proxy.pierced = false;
            proxy.state = ContactState::open;
            return;
        }
        for (int k = 0; k < 3; k++) proxy.displacement[k] = (deep - proxy.insertion) * proxy.axis[k];
    }

    // The blade draws the end of the cut behind it. What a hand puts in is stored in the spring, or has been cut and
    // rubbed: no loop gives it energy.
    void cut() {
        approach(proxy.tip, command.point, settings.motion);
        std::copy_n(surface.closest(proxy.tip).point, 3, proxy.tip); // a hand that is off the surface cuts no less
        const double most = settings.blade.resistance(proxy.at.point, command.displacement);
        double ahead = distance(proxy.tip, proxy.at.point);
        if (most == 0 || proxy.stiffness * ahead > most) {
            const double part = most == 0 ? 1 : 1 - most / (proxy.stiffness * ahead);
            double point[3];
            for (int k = 0; k < 3; k++) point[k] = proxy.at.point[k] + part * (proxy.tip[k] - proxy.at.point[k]);
            proxy.at = surface.closest(point);
            ahead = distance(proxy.tip, proxy.at.point);
        }
        const double stiffness = proxy.stiffness * ahead > most ? most / ahead : proxy.stiffness;
        proxy.resistance = most;
        for (int k = 0; k < 3; k++) {
            proxy.displacement[k] = proxy.tip[k] - proxy.at.point[k];
            proxy.force[k] = -stiffness * proxy.displacement[k];
        }
    }

    void begin(bool others) {
        const bool in_space = command.kind == CommandKind::free;
        proxy = ToolProxy();
        proxy.kind = command.kind;
        proxy.at = surface.closest(command.point);
        std::copy_n(command.point, 3, proxy.tip);
        if (command.kind == CommandKind::blade) {
            proxy.state = ContactState::cutting;
            proxy.stiffness = settings.blade.most(length(command.displacement)) / settings.blade.give;
            return;
        }
        proxy.state = others || command.kind != CommandKind::hold ? ContactState::open : ContactState::closed;
        if (find_patch() && in_space) detect_contact();
    }
};

} // namespace

double BladeForces::resistance(const double at[3], const double edge[3]) const {
    if (!tissue) return friction * length(edge);
    const CutResistance::Edge met = tissue->along(at, edge);
    return 1e-3 * met.toughness + friction * met.inside;
}

bool is_finite(const Command& command) {
    double sum = 0;
    for (int k = 0; k < 3; k++) sum += command.point[k] + command.displacement[k];
    return std::isfinite(sum);
}

void approach(double from[3], const double to[3], const ToolMotion& motion) {
    double way = distance(from, to);
    double part = way * motion.approach > motion.reach ? motion.reach / way : motion.approach;
    if (way < 1e-6) part = 1; // mm: arrives, so that a still command gives a still contact
    for (int k = 0; k < 3; k++) from[k] += part * (to[k] - from[k]);
}

bool find_patch(ToolProxy& proxy, const ContactSurface& surface, const ToolSettings& settings,
                SurfaceScratch& scratch) {
    const auto status = settings.nodal_weights ? surface.nodal_patch(proxy.at, settings.radius, scratch, proxy.patch)
                                               : surface.patch(proxy.at, settings.radius, scratch, proxy.patch);
    if (status == ContactSurface::PatchStatus::good) return true;
    proxy.state = ContactState::refused;
    return false;
}

void update_proxy(ToolProxy& proxy, const Command& command, const ContactSurface& surface, const ToolSettings& settings,
                  bool others, bool known, SurfaceScratch& scratch) {
    const bool opens = command.kind == CommandKind::free && proxy.kind == CommandKind::hold;
    const bool closes = command.kind == CommandKind::hold && proxy.kind == CommandKind::free;
    if (proxy.state == ContactState::closed && (opens || closes)) { // it grasps or lets go where it touches
        proxy.kind = command.kind;
        proxy.seen_outside = true;
        std::fill_n(proxy.filtered_slope, 3, 0.0);
        proxy.compliance = 0;
        proxy.clear_drag();
    }
    if (command.kind == CommandKind::away || command.kind != proxy.kind) {
        const bool refused = proxy.state == ContactState::refused && command.kind != CommandKind::away;
        proxy.kind = command.kind;
        if (!refused) proxy.state = ContactState::idle;
        proxy.clear_forces();
        if (command.kind == CommandKind::away) return;
    }
    if (proxy.state == ContactState::refused) return;
    if (!is_finite(command)) {
        proxy.state = ContactState::refused;
        return;
    }
    ProxyUpdate update{proxy, command, surface, settings, scratch};
    if (proxy.state == ContactState::idle) {
        update.begin(others);
        if (proxy.state != ContactState::closed) return;
    }
    if (command.kind == CommandKind::free) return update.follow_in_space();
    if (command.kind == CommandKind::blade) return update.cut();
    if (command.kind == CommandKind::needle) {
        proxy.pierced ? update.insert_needle() : update.press_needle();
    } else {
        if (proxy.state == ContactState::open && !known)
            return; // beside another tool: starts from the tissue's displacement there
        proxy.state = ContactState::closed;
        update.hold();
    }
    for (int k = 0; k < 3; k++)
        proxy.tip[k] = proxy.at.point[k] + (command.kind == CommandKind::needle ? proxy.way[k] : proxy.displacement[k]);
}

} // namespace palpate
