// Dot products of doubles, and lengths and distances of 3-vectors of them.
#pragma once
#include "base/cpu_dispatch.h"
#include <cmath>

namespace palpate {

inline double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline double length(const double a[3]) { return std::sqrt(dot(a, a)); }
inline double square_of_distance(const double a[3], const double b[3]) {
    const double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return dot(d, d);
}
inline double distance(const double a[3], const double b[3]) { return std::sqrt(square_of_distance(a, b)); }

// Of n numbers. Eight partial sums, always in the same order: vectorises without leave to reorder.
PALPATE_INLINE double dot(const double* a, const double* b, int n) {
    double part[8] = {0, 0, 0, 0, 0, 0, 0, 0};
    int i = 0;
    for (; i + 8 <= n; i += 8)
        for (int k = 0; k < 8; k++) part[k] += a[i + k] * b[i + k];
    double sum = ((part[0] + part[4]) + (part[2] + part[6])) + ((part[1] + part[5]) + (part[3] + part[7]));
    for (; i < n; i++) sum += a[i] * b[i];
    return sum;
}

} // namespace palpate
