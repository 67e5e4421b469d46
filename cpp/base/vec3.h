// Dot product and length of 3-vectors of doubles.
#pragma once
#include <cmath>

namespace palpate {

inline double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline double length(const double a[3]) { return std::sqrt(dot(a, a)); }

} // namespace palpate
