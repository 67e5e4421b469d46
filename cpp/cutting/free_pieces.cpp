#include "cutting/free_pieces.h"
#include "base/vec3.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr double on_a_line = 1e-6; // of the held nodes' extent

// Whether these points (mm) are not all on one line: held, they leave no rigid motion.
bool hold_still(const std::vector<Point3>& points) {
    const auto furthest = [&](const auto& size) {
        double most = 0;
        Point3 found{0, 0, 0};
        for (const Point3& x : points) {
            const double d[3] = {x[0] - points[0][0], x[1] - points[0][1], x[2] - points[0][2]};
            if (size(d) > most) most = size(d), found = {d[0], d[1], d[2]};
        }
        return std::pair(most, found);
    };
    if (points.empty()) return false;
    const auto [long_side, axis] = furthest([](const double* d) { return length(d); });
    const auto off_axis = [&, size = long_side, along = axis](const double* d) {
        const double part = dot(d, along.data()) / (size * size);
        const double off[3] = {d[0] - part * along[0], d[1] - part * along[1], d[2] - part * along[2]};
        return length(off);
    };
    return long_side > 0 && furthest(off_axis).first > on_a_line * long_side;
}

} // namespace

void take_free_pieces(SlitComplex& slit, const SlitParts& parts, const uint8_t* held, int node_count) {
    std::vector<std::vector<Point3>> points(*std::max_element(parts.body.begin(), parts.body.end()) + 1);
    for (int i = 0; i < parts.count(); i++)
        for (int p : slit.corner[i]) // the first points are the nodes
            if (p < node_count && held[p])
                points[parts.body[i]].push_back(
                    {slit.place[3 * size_t(p)], slit.place[3 * size_t(p) + 1], slit.place[3 * size_t(p) + 2]});
    std::vector<uint8_t> stays;
    for (const auto& of_body : points) stays.push_back(hold_still(of_body));
    for (int i = 0; i < parts.count(); i++) slit.gone[i] |= !stays[parts.body[i]];
}

} // namespace palpate
