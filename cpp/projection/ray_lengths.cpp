#include "projection/ray_lengths.h"
#include "base/cpu_dispatch.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// The largest u for which three terms of the series are used; the error is 5 u⁴ / 128.
constexpr float max_u = 0.03f;

} // namespace

PALPATE_KERNEL void scale_by_series(const float* __restrict difference, float per_square, float length, int count,
                                    const float* from, float* to) {
    for (int i = 0; i < count; i++) {
        const float u = difference[i] * per_square;
        to[i] = from[i] * (length + length * u * (0.5f - u * (0.125f - u * 0.0625f)));
    }
}

PALPATE_KERNEL void scale_by_roots(const float* __restrict difference, float square, float scale, int count,
                                   const float* from, float* to) {
    for (int i = 0; i < count; i++) to[i] = from[i] * (scale * std::sqrt(square + difference[i]));
}

// The squared distances, and distances, of the points middle + row * down for rows from `first` on.
PALPATE_KERNEL void distances(const Vec3& middle, const Vec3& down, int first, int count, float* __restrict square,
                              float* __restrict root) {
    for (int i = 0; i < count; i++) {
        double sum = 0;
        for (int k = 0; k < 3; k++) sum += (middle[k] + (first + i) * down[k]) * (middle[k] + (first + i) * down[k]);
        square[i] = float(sum);
        root[i] = float(std::sqrt(sum));
    }
}

void RayLengths::make(const View& v, int begin, int columns, int from, int to) {
    count = columns, first = from;
    if (int(difference.size()) < count) difference.resize(count);
    if (int(square.size()) < to - from) square.resize(to - from), root.resize(to - from);
    const int centre = count / 2;
    const auto at = [&](int row, int column, int k) {
        const int64_t pixel = v.start + row * v.step_b + column * v.step_a;
        return v.path.first[k] + double(pixel / v.path.columns) * v.path.row[k] +
               double(pixel % v.path.columns) * v.path.column[k];
    };
    Vec3 middle, down; // mm, from the focal spot to the middle column of row 0, and from row to row
    double along = 0, step = 0;
    for (int k = 0; k < 3; k++) {
        middle[k] = at(0, begin + centre, k);
        down[k] = v.nb > 1 ? at(1, begin + centre, k) - middle[k] : 0;
        const double right = centre > 0 ? middle[k] - at(0, begin + centre - 1, k) : 0;
        along += middle[k] * right, step += right * right;
    }
    per_height = float(v.path.thickness / std::fabs(middle[2]));
    distances(middle, down, from, to - from, square.data(), root.data());
    double greatest = 0;
    for (int i = 0; i < count; i++) {
        const double d = i - centre, change = d * (2 * along + d * step); // rows and columns are at right angles
        difference[i] = float(change);
        greatest = std::max(greatest, std::fabs(change));
    }
    max_difference = float(greatest);
}

void RayLengths::scale(int row, const float* from, float* to) const {
    const float s = square[row - first];
    if (max_difference < max_u * s)
        scale_by_series(difference.data(), 1 / s, per_height * root[row - first], count, from, to);
    else
        scale_by_roots(difference.data(), s, per_height, count, from, to);
}

} // namespace palpate
