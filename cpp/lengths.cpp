#include "lengths.h"
#include "dispatch.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double small =
    0.03; // u, up to which three terms of the series of √(1 + u) have an error below 5 u⁴ / 128 = 3e-8

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

void Lengths::make(const View& v, int first, int columns) {
    view = &v, begin = first, count = columns, middle = begin + count / 2;
    if (int(beyond.size()) < count) beyond.resize(count);
    double at[3], next[3], along = 0, step = 0;
    vector(0, middle, at);
    vector(0, middle + 1, next);
    for (int k = 0; k < 3; k++) along += at[k] * (next[k] - at[k]), step += (next[k] - at[k]) * (next[k] - at[k]);
    most = 0;
    for (int i = 0; i < count; i++) {
        const double d = begin + i - middle, change = d * (2 * along + d * step);
        beyond[i] = float(change);
        most = std::max(most, std::fabs(change));
    }
}

void Lengths::scale(int row, const float* from, float* to) const {
    double at[3];
    vector(row, middle, at);
    const double square = at[0] * at[0] + at[1] * at[1] + at[2] * at[2];
    const double scale = view->path.thickness / std::fabs(at[2]);
    if (most < small * square)
        scale_by_series(beyond.data(), float(1 / square), float(scale * std::sqrt(square)), count, from, to);
    else
        scale_by_roots(beyond.data(), float(square), float(scale), count, from, to);
}

// mm, from the focal spot to a pixel of the image.
void Lengths::vector(int row, int column, double* out) const {
    const Path& path = view->path;
    const int64_t pixel = view->start + row * view->step_b + column * view->step_a;
    const double r = double(pixel / path.columns), c = double(pixel % path.columns);
    for (int k = 0; k < 3; k++) out[k] = path.first[k] + r * path.row[k] + c * path.column[k];
}

} // namespace palpate
