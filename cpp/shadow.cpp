#include "shadow.h"
#include "dispatch.h"
#include "elementary.h"
#include "parallel.h"
#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

constexpr int64_t most = 256; // rays at once
constexpr double infinite = std::numeric_limits<double>::infinity();

// Rays of one row, `count` from `begin` on: source + t·(start + k·right), t from 0 to 1.
struct Line {
    double start[3];
    const double *source, *right;
    int64_t begin, count;
};

struct Spans {
    double enter[most], leave[most];
};

// Roots of |s + t·d|² = 1, where the ellipsoid is the unit ball; from the point of the line next to the centre, so that
// no large squares are subtracted.
PALPATE_KERNEL void meet_ellipsoid(const double* solid, const Line& line, Spans& spans) {
    double s[3] = {}, d[3] = {}, step[3] = {};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double turn = solid[j * 3 + i];
            s[i] += (line.source[j] - solid[9 + j]) * turn;
            d[i] += line.start[j] * turn;
            step[i] += line.right[j] * turn;
        }
    for (int64_t k = 0; k < line.count; k++) {
        const double at = double(line.begin + k);
        const double x = d[0] + at * step[0], y = d[1] + at * step[1], z = d[2] + at * step[2];
        const double inverse = 1 / (x * x + y * y + z * z), nearest = -(s[0] * x + s[1] * y + s[2] * z) * inverse;
        const double gx = s[0] + nearest * x, gy = s[1] + nearest * y, gz = s[2] + nearest * z;
        const double square = (1 - (gx * gx + gy * gy + gz * gz)) * inverse;
        const double half = square > 0 ? std::sqrt(square > 0 ? square : 0) : -infinite;
        spans.enter[k] = std::max(spans.enter[k], nearest - half);
        spans.leave[k] = std::min(spans.leave[k], nearest + half);
    }
}

// Between the last of the three pairs of planes entered and the first left.
PALPATE_KERNEL void meet_box(const double* solid, const Line& line, Spans& spans) {
    for (int axis = 0; axis < 3; axis++) {
        const double s = line.source[axis], low = solid[axis] - s, high = solid[3 + axis] - s;
        const double outside = low <= 0 && high >= 0 ? -infinite : infinite; // of a ray along these two planes
        for (int64_t k = 0; k < line.count; k++) {
            const double d = line.start[axis] + double(line.begin + k) * line.right[axis];
            const bool level = d == 0;
            const double a = low / d, b = high / d;
            const double first = level ? outside : std::min(a, b), last = level ? -outside : std::max(a, b);
            spans.enter[k] = std::max(spans.enter[k], first);
            spans.leave[k] = std::min(spans.leave[k], last);
        }
    }
}

PALPATE_KERNEL void add_chords(const Line& line, const Spans& spans, double attenuation, double* total) {
    for (int64_t k = 0; k < line.count; k++) {
        const double at = double(line.begin + k);
        const double x = line.start[0] + at * line.right[0], y = line.start[1] + at * line.right[1],
                     z = line.start[2] + at * line.right[2];
        const double inside = std::min(spans.leave[k], 1.0) - std::max(spans.enter[k], 0.0);
        total[k] += attenuation * std::max(inside, 0.0) * std::sqrt(x * x + y * y + z * z);
    }
}

PALPATE_KERNEL void pass(const double* total, int64_t count, double* passed) {
    for (int64_t k = 0; k < count; k++) passed[k] = fast_exp(-total[k]);
}

// The share of the beam that a row of rays lets through, at rays begin .. begin + count - 1.
void pass_row(const Solids& solids, const Rays& rays, int64_t row, int64_t begin, int64_t count, double* passed) {
    double total[most] = {};
    Spans spans;
    Line line{{}, rays.source, rays.right, begin, count};
    for (int i = 0; i < 3; i++) line.start[i] = rays.origin[i] + double(row) * rays.down[i] - rays.source[i];
    for (int64_t p = 0; p < solids.parts; p++) {
        const int64_t* range = solids.ranges + 4 * p;
        if (row < range[0] || row > range[1] || begin > range[3] || begin + count <= range[2]) continue;
        std::fill_n(spans.enter, count, -infinite);
        std::fill_n(spans.leave, count, infinite);
        for (int64_t i = solids.first[p]; i < solids.first[p + 1]; i++) {
            const double* solid = solids.solid + i * Solids::numbers;
            solids.kind[i] == 0 ? meet_ellipsoid(solid, line, spans) : meet_box(solid, line, spans);
        }
        add_chords(line, spans, solids.attenuation[p], total);
    }
    pass(total, count, passed);
}

} // namespace

void transmission(const Solids& solids, const Rays& rays, double* out) {
    const int64_t n = rays.subrays, step = std::max<int64_t>(1, most / n); // pixels at once
    parallel(rays.rows, [&](int64_t first, int64_t last, int) {
        double passed[most];
        for (int64_t row = first; row < last; row++)
            for (int64_t column = 0; column < rays.columns; column += step) {
                double* pixels = out + row * rays.columns + column;
                const int64_t count = std::min(step, rays.columns - column);
                std::fill_n(pixels, count, 0.0);
                for (int64_t i = 0; i < n; i++)
                    for (int64_t begin = 0; begin < count * n; begin += most) { // once, but for very many subrays
                        const int64_t some = std::min(most, count * n - begin);
                        pass_row(solids, rays, row * n + i, column * n + begin, some, passed);
                        for (int64_t k = 0; k < some; k++) pixels[(begin + k) / n] += passed[k];
                    }
                for (int64_t k = 0; k < count; k++) pixels[k] /= double(n * n);
            }
    });
}

} // namespace palpate
