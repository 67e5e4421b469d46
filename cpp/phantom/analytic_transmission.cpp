#include "phantom/analytic_transmission.h"
#include "base/cpu_dispatch.h"
#include "base/thread_pool.h"
#include "base/vector_math.h"
#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

constexpr int64_t max_rays = 256; // at once
constexpr double infinite = std::numeric_limits<double>::infinity();

// Rays of one row, `count` from `begin` on: source + t·(start + k·right), t from 0 to 1.
struct Line {
    double start[3];
    const double *source, *right;
    int64_t begin, count;
};

struct Intervals {
    double enter[max_rays], leave[max_rays];
};

// Roots of |s + t·d|² = 1, in coordinates where the ellipsoid is the unit ball; counted from the point of the ray
// nearest to the centre, so that no large squares are subtracted.
PALPATE_KERNEL void intersect_ellipsoid(const double* solid, const Line& line, Intervals& intervals) {
    double s[3] = {}, d[3] = {}, step[3] = {};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double axis = solid[j * 3 + i];
            s[i] += (line.source[j] - solid[9 + j]) * axis;
            d[i] += line.start[j] * axis;
            step[i] += line.right[j] * axis;
        }
    for (int64_t k = 0; k < line.count; k++) {
        const double at = double(line.begin + k);
        const double x = d[0] + at * step[0], y = d[1] + at * step[1], z = d[2] + at * step[2];
        const double inverse = 1 / (x * x + y * y + z * z), nearest = -(s[0] * x + s[1] * y + s[2] * z) * inverse;
        const double gx = s[0] + nearest * x, gy = s[1] + nearest * y, gz = s[2] + nearest * z;
        const double square = (1 - (gx * gx + gy * gy + gz * gz)) * inverse;
        const double half = square > 0 ? std::sqrt(square > 0 ? square : 0) : -infinite;
        intervals.enter[k] = std::max(intervals.enter[k], nearest - half);
        intervals.leave[k] = std::min(intervals.leave[k], nearest + half);
    }
}

// From the last of the three pairs of planes that the ray enters to the first that it leaves.
PALPATE_KERNEL void intersect_box(const double* solid, const Line& line, Intervals& intervals) {
    for (int axis = 0; axis < 3; axis++) {
        const double s = line.source[axis], low = solid[axis] - s, high = solid[3 + axis] - s;
        const double beside = low <= 0 && high >= 0 ? -infinite : infinite; // for a ray parallel to these two planes
        for (int64_t k = 0; k < line.count; k++) {
            const double d = line.start[axis] + double(line.begin + k) * line.right[axis];
            const bool parallel_to_planes = d == 0;
            const double a = low / d, b = high / d;
            const double first = parallel_to_planes ? beside : std::min(a, b),
                         last = parallel_to_planes ? -beside : std::max(a, b);
            intervals.enter[k] = std::max(intervals.enter[k], first);
            intervals.leave[k] = std::min(intervals.leave[k], last);
        }
    }
}

PALPATE_KERNEL void add_chords(const Line& line, const Intervals& intervals, double attenuation, double* total) {
    for (int64_t k = 0; k < line.count; k++) {
        const double at = double(line.begin + k);
        const double x = line.start[0] + at * line.right[0], y = line.start[1] + at * line.right[1],
                     z = line.start[2] + at * line.right[2];
        const double inside = std::min(intervals.leave[k], 1.0) - std::max(intervals.enter[k], 0.0);
        total[k] += attenuation * std::max(inside, 0.0) * std::sqrt(x * x + y * y + z * z);
    }
}

PALPATE_KERNEL void exponentials(const double* total, int64_t count, double* transmitted) {
    for (int64_t k = 0; k < count; k++) transmitted[k] = fast_exp(-total[k]);
}

// The transmission of rays begin .. begin + count - 1 of a row of rays.
void transmit_row(const Solids& solids, const Rays& rays, int64_t row, int64_t begin, int64_t count,
                  double* transmitted) {
    double total[max_rays] = {};
    Intervals intervals;
    Line line{{}, rays.source, rays.right, begin, count};
    for (int i = 0; i < 3; i++) line.start[i] = rays.origin[i] + double(row) * rays.down[i] - rays.source[i];
    for (int64_t p = 0; p < solids.parts; p++) {
        const int64_t* range = solids.ranges + 4 * p;
        if (row < range[0] || row > range[1] || begin > range[3] || begin + count <= range[2]) continue;
        std::fill_n(intervals.enter, count, -infinite);
        std::fill_n(intervals.leave, count, infinite);
        for (int64_t i = solids.first[p]; i < solids.first[p + 1]; i++) {
            const double* solid = solids.solid + i * Solids::numbers;
            solids.kind[i] == 0 ? intersect_ellipsoid(solid, line, intervals) : intersect_box(solid, line, intervals);
        }
        add_chords(line, intervals, solids.attenuation[p], total);
    }
    exponentials(total, count, transmitted);
}

} // namespace

void transmission(const Solids& solids, const Rays& rays, double* out) {
    const int64_t n = rays.subrays, step = std::max<int64_t>(1, max_rays / n); // pixels at once
    parallel(rays.rows, [&](int64_t first, int64_t last, int) {
        double transmitted[max_rays];
        for (int64_t row = first; row < last; row++)
            for (int64_t column = 0; column < rays.columns; column += step) {
                double* pixels = out + row * rays.columns + column;
                const int64_t count = std::min(step, rays.columns - column);
                std::fill_n(pixels, count, 0.0);
                for (int64_t i = 0; i < n; i++)
                    for (int64_t begin = 0; begin < count * n;
                         begin += max_rays) { // more than once only for very many subrays
                        const int64_t some = std::min(max_rays, count * n - begin);
                        transmit_row(solids, rays, row * n + i, column * n + begin, some, transmitted);
                        for (int64_t k = 0; k < some; k++) pixels[(begin + k) / n] += transmitted[k];
                    }
                for (int64_t k = 0; k < count; k++) pixels[k] /= double(n * n);
            }
    });
}

} // namespace palpate
