// The point of a triangle closest to a point: C. Ericson, Real-Time Collision Detection (2005), section 5.1.5.
#pragma once
#include "base/vec3.h"

namespace palpate {

inline void minus(const double* a, const double* b, double* out) {
    for (int k = 0; k < 3; k++) out[k] = a[k] - b[k];
}
inline void cross(const double* a, const double* b, double* out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

// Barycentric weights of the triangle's point closest to p, by the Voronoi regions of corners, edges and face.
inline void closest_weights(const double* p, const double* a, const double* b, const double* c, double w[3]) {
    double ab[3], ac[3], ap[3], bp[3], cp[3];
    minus(b, a, ab), minus(c, a, ac), minus(p, a, ap), minus(p, b, bp), minus(p, c, cp);
    auto set = [&](double u, double v, double x) { w[0] = u, w[1] = v, w[2] = x; };
    double d1 = dot(ab, ap), d2 = dot(ac, ap);
    if (d1 <= 0 && d2 <= 0) return set(1, 0, 0);
    double d3 = dot(ab, bp), d4 = dot(ac, bp);
    if (d3 >= 0 && d4 <= d3) return set(0, 1, 0);
    double d5 = dot(ab, cp), d6 = dot(ac, cp);
    if (d6 >= 0 && d5 <= d6) return set(0, 0, 1);
    double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return set(1 - d1 / (d1 - d3), d1 / (d1 - d3), 0);
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return set(1 - d2 / (d2 - d6), 0, d2 / (d2 - d6));
    double from_b = d4 - d3, from_c = d5 - d6;
    if (va <= 0 && from_b >= 0 && from_c >= 0) return set(0, from_c / (from_b + from_c), from_b / (from_b + from_c));
    double sum = va + vb + vc;
    set(va / sum, vb / sum, vc / sum);
}

} // namespace palpate
