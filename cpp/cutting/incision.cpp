#include "cutting/incision.h"
#include "base/vec3.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double least_height = 1e-6; // mm: a flatter triangle has no plane, and palpate.Blade refuses it
constexpr double least_way = 1e-6;    // of a sum of normals, or a direction: a shorter one points nowhere

// Points of a polyline, its corners among them, no farther from each other than `step` mm.
std::vector<Point3> along(const std::vector<Point3>& corners, double step) {
    std::vector<Point3> out(corners.begin(), corners.begin() + 1);
    for (size_t k = 1; k < corners.size(); k++) {
        const Point3 &a = corners[k - 1], &b = corners[k];
        const int parts = std::max(1, int(std::ceil(distance(a.data(), b.data()) / step)));
        for (int p = 1; p <= parts; p++) {
            Point3 x;
            for (int d = 0; d < 3; d++) x[d] = a[d] + double(p) / parts * (b[d] - a[d]);
            out.push_back(x);
        }
    }
    return out;
}

} // namespace

Incision incision(const ContactSurface& surface, const std::vector<Point3>& path, double step, double above,
                  const double* direction) {
    Incision out{{0, 0, 0}, along(path, step)};
    std::vector<SurfacePoint> hits;
    for (const Point3& x : out.upper) {
        hits.push_back(surface.closest(x.data()));
        double normal[3];
        surface.normal(hits.back(), normal);
        for (int d = 0; d < 3; d++) out.way[d] -= normal[d];
    }
    if (direction) std::copy_n(direction, 3, out.way.begin());
    const double size = length(out.way.data());
    if (!(size > least_way)) return {{0, 0, 0}, {}};
    for (double& v : out.way) v /= size;
    for (size_t k = 0; k < hits.size(); k++) {
        double deeper = -above;
        for (int d = 0; d < 3; d++) deeper += out.way[d] * (hits[k].point[d] - out.upper[k][d]);
        for (int d = 0; d < 3; d++) out.upper[k][d] += deeper * out.way[d];
    }
    return out;
}

std::vector<BladeTriangle> Incision::swept(double depth) const {
    std::vector<BladeTriangle> out;
    const auto under = [&](const Point3& x) {
        return Point3{x[0] + depth * way[0], x[1] + depth * way[1], x[2] + depth * way[2]};
    };
    for (const bool second : {false, true}) // as Blade.swept has them: the order has a say in how lips are triangulated
        for (size_t k = 1; k < upper.size(); k++) {
            const Point3 &a = upper[k - 1], &b = upper[k], below_a = under(a), below_b = under(b);
            double along = 0;
            for (int d = 0; d < 3; d++) along += (b[d] - a[d]) * way[d];
            const double step = distance(a.data(), b.data()),
                         across = std::sqrt(std::max(step * step - along * along, 0.0));
            if (across * depth <= least_height * std::max(step, depth)) return {};
            if (second)
                out.emplace_back(a.data(), below_b.data(), below_a.data());
            else
                out.emplace_back(a.data(), b.data(), below_b.data());
        }
    return out;
}

} // namespace palpate
