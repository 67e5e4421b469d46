#include "lengths.h"
#include "dispatch.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// u up to which three terms of the series are enough: what is left out is 5 u⁴ / 128.
constexpr double small = 0.03;

} // namespace

PALPATE_KERNEL void scale_by_series(const float* __restrict beyond, float per_square, float length, int count,
                                    const float* from, float* to) {
    for (int i = 0; i < count; i++) {
        const float u = beyond[i] * per_square;
        to[i] = from[i] * (length + length * u * (0.5f - u * (0.125f - u * 0.0625f)));
    }
}

PALPATE_KERNEL void scale_by_roots(const float* __restrict beyond, float square, float scale, int count,
                                   const float* from, float* to) {
    for (int i = 0; i < count; i++) to[i] = from[i] * (scale * std::sqrt(square + beyond[i]));
}

void Lengths::make(const View& v, int begin, int columns) {
    count = columns, thickness = v.path.thickness;
    if (int(beyond.size()) < count) beyond.resize(count);
    const int centre = count / 2;
    const auto at = [&](int row, int column, int k) {
        const int64_t pixel = v.start + row * v.step_b + column * v.step_a;
        return v.path.first[k] + double(pixel / v.path.columns) * v.path.row[k] +
               double(pixel % v.path.columns) * v.path.column[k];
    };
    double along = 0, step = 0;
    for (int k = 0; k < 3; k++) {
        middle[k] = at(0, begin + centre, k);
        down[k] = v.nb > 1 ? at(1, begin + centre, k) - middle[k] : 0;
        const double right = centre > 0 ? middle[k] - at(0, begin + centre - 1, k) : 0;
        along += middle[k] * right, step += right * right;
    }
    most = 0;
    for (int i = 0; i < count; i++) {
        const double d = i - centre, change = d * (2 * along + d * step); // rows and columns are at right angles
        beyond[i] = float(change);
        most = std::max(most, std::fabs(change));
    }
}

void Lengths::scale(int row, const float* from, float* to) const {
    double square = 0;
    for (int k = 0; k < 3; k++) square += (middle[k] + row * down[k]) * (middle[k] + row * down[k]);
    const double per_height = thickness / std::fabs(middle[2]);
    if (most < small * square)
        scale_by_series(beyond.data(), float(1 / square), float(per_height * std::sqrt(square)), count, from, to);
    else
        scale_by_roots(beyond.data(), float(square), float(per_height), count, from, to);
}

} // namespace palpate
