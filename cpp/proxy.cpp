#include "proxy.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

bool finite(const Command& command) {
    double sum = 0;
    for (int k = 0; k < 3; k++) sum += command.point[k] + command.displacement[k];
    return std::isfinite(sum);
}

double apart(const double a[3], const double b[3]) {
    return std::sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}

void glide(double from[3], const double to[3], const Pace& pace) {
    double way = apart(from, to);
    double part = way * pace.approach > pace.reach ? pace.reach / way : pace.approach;
    if (way < 1e-6) part = 1; // mm: arrives, so that a still hand gives a still contact
    for (int k = 0; k < 3; k++) from[k] += part * (to[k] - from[k]);
}

} // namespace

void follow(Proxy& proxy, const Command& command, const Surface& surface, double radius, const Pace& pace,
            SurfaceScratch& scratch) {
    if (!command.held) {
        proxy.grip = Proxy::Grip::idle;
        return;
    }
    if (proxy.grip == Proxy::Grip::refused) return;
    if (!finite(command)) {
        proxy.grip = Proxy::Grip::refused;
        return;
    }
    Hit before = proxy.at;
    bool taken = proxy.grip == Proxy::Grip::idle;
    if (taken) {
        proxy.at = surface.closest(command.point);
        std::fill_n(proxy.displacement, 3, 0.0);
        proxy.grip = Proxy::Grip::holding;
    } else if (apart(proxy.at.point, command.point) > 0) {
        double point[3];
        std::copy_n(proxy.at.point, 3, point);
        glide(point, command.point, pace);
        proxy.at = surface.closest(point);
    }
    if (taken || apart(before.point, proxy.at.point) > 0)
        if (surface.patch(proxy.at, radius, scratch, proxy.patch) != Surface::Contact::good)
            proxy.grip = Proxy::Grip::refused;
    glide(proxy.displacement, command.displacement, pace);
}

} // namespace palpate
