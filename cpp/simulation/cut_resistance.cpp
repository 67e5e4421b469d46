#include "simulation/cut_resistance.h"
#include "base/vec3.h"
#include "tissue/closest_point.h"
#include <algorithm>
#include <numeric>

namespace palpate {
namespace {

constexpr double moved = 1e-8;                        // of the body's size
constexpr double askew[3] = {0.5347, 0.3219, 0.7813}; // in no plane that a mesh is likely to have

// The part of a line that is there, from `begin` to `end` in lengths of its way.
struct Part {
    double begin = 0, end = 1;
    // Keeps where `value` + t `slope` >= 0.
    void clip(double value, double slope) {
        if (slope == 0) {
            if (value < 0) end = begin;
        } else if (const double t = -value / slope; slope > 0)
            begin = std::max(begin, t);
        else
            end = std::min(end, t);
    }
    bool empty() const { return !(begin < end); }
};

bool meets(const Bounds& box, const double point[3], const double way[3]) {
    Part part;
    for (int k = 0; k < 3; k++) {
        part.clip(point[k] - box.low[k], way[k]);
        part.clip(box.high[k] - point[k], -way[k]);
    }
    return !part.empty();
}

} // namespace

CutResistance::CutResistance(const double* node, const int32_t* tet, const int32_t* region, int count,
                             const int32_t* labels, const double* tough, int regions)
    : label(labels, labels + regions), toughness(tough, tough + regions),
      toughest(std::accumulate(tough, tough + regions, 0.0, [](double a, double b) { return std::max(a, b); })),
      tets(count) {
    std::vector<Bounds> bounds(count);
    std::vector<double> centre(3 * size_t(count), 0.0);
    Bounds all;
    for (int t = 0; t < count; t++) {
        const auto at = std::find(label.begin(), label.end(), region[t]) - label.begin();
        tets[t].toughness = at < regions ? toughness[at] : 0;
        for (int c = 0; c < 4; c++) {
            const double* x = node + 3 * size_t(tet[4 * size_t(t) + c]);
            std::copy_n(x, 3, tets[t].corner[c].begin());
            bounds[t].add(x), all.add(x);
            for (int k = 0; k < 3; k++) centre[3 * size_t(t) + k] += x[k];
        }
    }
    tree.build(bounds, centre);
    const double size = count > 0 ? distance(all.low, all.high) : 0;
    for (int k = 0; k < 3; k++) aside[k] = moved * size * askew[k];
}

CutResistance::Edge CutResistance::along(const double from[3], const double way[3]) const {
    Edge sum;
    const double size = length(way), point[3] = {from[0] + aside[0], from[1] + aside[1], from[2] + aside[2]};
    int stack[BoxTree::deepest], depth = 0;
    if (!tree.box.empty()) stack[depth++] = 0;
    while (depth > 0) {
        const int at = stack[--depth];
        const BoxTree::Box& box = tree.box[at];
        if (!meets(box, point, way)) continue;
        if (box.count == 0) {
            stack[depth++] = box.first;
            stack[depth++] = at + 1;
            continue;
        }
        for (int i = box.first; i < box.first + box.count; i++) {
            const Tet& one = tets[tree.order[i]];
            Part part;
            for (int c = 0; c < 4; c++) { // its side of each face
                const double *a = one.corner[(c + 1) % 4].data(), *opposite = one.corner[c].data();
                double e[3], f[3], normal[3], to_point[3], to_opposite[3];
                minus(one.corner[(c + 2) % 4].data(), a, e);
                minus(one.corner[(c + 3) % 4].data(), a, f);
                cross(e, f, normal);
                minus(point, a, to_point);
                minus(opposite, a, to_opposite);
                const double inward = dot(normal, to_opposite) < 0 ? -1 : 1;
                part.clip(inward * dot(normal, to_point), inward * dot(normal, way));
            }
            if (part.empty()) continue;
            sum.inside += (part.end - part.begin) * size;
            sum.toughness += (part.end - part.begin) * size * one.toughness;
        }
    }
    return sum;
}

} // namespace palpate
