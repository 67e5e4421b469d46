// Points, normals and boxes of a ContactSurface whose vertices are somewhere else than at rest: `position` (vertices,
// 3) mm. Self-contact asks for them in its solver's thread.
#pragma once
#include "tissue/closest_point.h"
#include "tissue/contact_surface.h"
#include <algorithm>
#include <limits>

namespace palpate {

// The point of a triangle that is closest to a point, and its barycentric weights.
inline void place(const ContactSurface& surface, const double* position, int triangle, const double* point,
                  double weight[3], double out[3]) {
    const int* v = &surface.corner[3 * size_t(triangle)];
    closest_weights(point, position + 3 * size_t(v[0]), position + 3 * size_t(v[1]), position + 3 * size_t(v[2]),
                    weight);
    for (int k = 0; k < 3; k++) {
        out[k] = 0;
        for (int c = 0; c < 3; c++) out[k] += weight[c] * position[3 * size_t(v[c]) + k];
    }
}

// Twice the area long.
inline void area_normal(const ContactSurface& surface, const double* position, int triangle, double out[3]) {
    const int* v = &surface.corner[3 * size_t(triangle)];
    double e[3], f[3];
    minus(position + 3 * size_t(v[1]), position + 3 * size_t(v[0]), e);
    minus(position + 3 * size_t(v[2]), position + 3 * size_t(v[0]), f);
    cross(e, f, out);
}

inline void add_unit_normal(const ContactSurface& surface, const double* position, int triangle, double factor,
                            double out[3]) {
    double n[3];
    area_normal(surface, position, triangle, n);
    const double size = length(n);
    for (int k = 0; k < 3 && size > 0; k++) out[k] += factor * n[k] / size;
}

// The angle of a triangle at one of its vertices.
inline double angle_at(const ContactSurface& surface, const double* position, int triangle, int vertex) {
    const int* v = &surface.corner[3 * size_t(triangle)];
    const int c = int(std::find(v, v + 3, vertex) - v);
    double e[3], f[3], n[3];
    minus(position + 3 * size_t(v[(c + 1) % 3]), position + 3 * size_t(vertex), e);
    minus(position + 3 * size_t(v[(c + 2) % 3]), position + 3 * size_t(vertex), f);
    cross(e, f, n);
    return std::atan2(length(n), dot(e, f));
}

// Boxes around the triangles where these are now: (boxes, 6).
inline void fit_boxes(const ContactSurface& surface, const double* position, double* box) {
    for (int at = int(surface.tree.box.size()) - 1; at >= 0; at--) {
        const BoxTree::Box& node = surface.tree.box[at];
        double* low = box + 6 * size_t(at);
        std::fill_n(low, 3, std::numeric_limits<double>::infinity()),
            std::fill_n(low + 3, 3, -std::numeric_limits<double>::infinity());
        auto add = [&](const double* least, const double* most) {
            for (int k = 0; k < 3; k++) low[k] = std::min(low[k], least[k]), low[3 + k] = std::max(low[3 + k], most[k]);
        };
        if (node.count == 0) {
            for (int child : {at + 1, node.first}) add(box + 6 * size_t(child), box + 6 * size_t(child) + 3);
            continue;
        }
        for (int i = 3 * node.first; i < 3 * (node.first + node.count); i++) {
            const double* x = position + 3 * size_t(surface.corner[3 * size_t(surface.tree.order[i / 3]) + i % 3]);
            add(x, x);
        }
    }
}

// Every triangle whose box is within `reach` mm of a point.
template <class Visit>
void visit_near(const ContactSurface& surface, const double* box, const double* point, double reach, Visit&& visit) {
    int stack[BoxTree::deepest], depth = 0;
    if (!surface.tree.box.empty()) stack[depth++] = 0;
    while (depth > 0) {
        const int at = stack[--depth];
        const double* low = box + 6 * size_t(at);
        double square = 0;
        for (int k = 0; k < 3; k++) {
            const double d = std::max({low[k] - point[k], point[k] - low[3 + k], 0.0});
            square += d * d;
        }
        if (square > reach * reach) continue;
        const BoxTree::Box& node = surface.tree.box[at];
        if (node.count == 0) {
            stack[depth++] = node.first;
            stack[depth++] = at + 1;
            continue;
        }
        for (int i = node.first; i < node.first + node.count; i++) visit(surface.tree.order[i]);
    }
}

} // namespace palpate
