#include "cutting/incision.h"
#include "base/vec3.h"
#include "tissue/closest_point.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double least_height = 1e-6;   // mm: a flatter triangle has no plane, and palpate.Blade refuses it
constexpr double least_way = 1e-6;      // of a sum of normals, or a direction: a shorter one points nowhere
constexpr double one_plane = 1e-6;      // of a way's length
constexpr size_t most_looked_at = 2000; // points: the time grows with their square

// The normal of the plane that a blade of this way sweeps from one point to another; false if it goes along itself.
bool plane_through(const Point3& first, const Point3& last, const double way[3], double normal[3]) {
    double chord[3];
    for (int d = 0; d < 3; d++) chord[d] = last[d] - first[d];
    cross(chord, way, normal);
    const double size = length(normal);
    if (!(size > least_way * length(chord))) return false;
    for (int d = 0; d < 3; d++) normal[d] /= size;
    return true;
}

double above(const Point3& x, const Point3& on, const double normal[3]) {
    return (x[0] - on[0]) * normal[0] + (x[1] - on[1]) * normal[1] + (x[2] - on[2]) * normal[2];
}

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

std::vector<Point3> straightened(std::vector<Point3> path, const double way[3]) {
    double within = 0, normal[3];
    for (size_t k = 1; k < path.size(); k++) within += one_plane * distance(path[k - 1].data(), path[k].data());
    const auto in_plane = [&](size_t first, size_t last) {
        if (!plane_through(path[first], path[last], way, normal)) return false;
        for (size_t k = first + 1; k < last; k++)
            if (std::abs(above(path[k], path[first], normal)) > within) return false;
        return true;
    };
    for (size_t first = 0; first + 1 < path.size() && path.size() <= most_looked_at;) {
        size_t last = first + 1;
        while (last + 1 < path.size() && in_plane(first, last + 1)) last++;
        const bool plane = plane_through(path[first], path[last], way, normal);
        for (size_t k = first + 1; k < last && plane; k++) {
            const double off = above(path[k], path[first], normal);
            for (int d = 0; d < 3; d++) path[k][d] -= off * normal[d];
        }
        first = last;
    }
    return path;
}

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
    const std::vector<Point3> end = straightened(upper, way.data());
    const auto under = [&](const Point3& x) {
        return Point3{x[0] + depth * way[0], x[1] + depth * way[1], x[2] + depth * way[2]};
    };
    for (const bool second : {false, true}) // as Blade.swept has them: the order has a say in how lips are triangulated
        for (size_t k = 1; k < end.size(); k++) {
            const Point3 &a = end[k - 1], &b = end[k], below_a = under(a), below_b = under(b);
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
