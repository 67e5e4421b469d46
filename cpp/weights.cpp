#include "weights.h"
#include "dispatch.h"
#include <algorithm>
#include <cmath>

namespace palpate {

// weight[i] = moment of the part of pixel first[i] + tap between edges i and i + 1, which move from `from` to `to`.
template <int moment>
PALPATE_INLINE void trapezoids_by(const double* __restrict from, const double* __restrict to, int begin, int end,
                                  int tap, const int32_t* __restrict first, float* __restrict weight) {
    for (int i = begin; i < end; i++) {
        const double q = first[i] + tap;
        double left[moment + 1], right[moment + 1];
        cover(from[i] - q, to[i] - q, moment + 1, left);
        cover(from[i + 1] - q, to[i + 1] - q, moment + 1, right);
        const double w = right[moment] - left[moment];
        weight[i] = std::fabs(w) > 1e-7 ? float(w) : 0.0f; // rounding must not tie a voxel to pixels it does not reach
    }
}

PALPATE_KERNEL void trapezoids(const double* from, const double* to, int begin, int end, int tap, int moment,
                               const int32_t* first, float* weight) {
    if (moment == 0) return trapezoids_by<0>(from, to, begin, end, tap, first, weight);
    if (moment == 1) return trapezoids_by<1>(from, to, begin, end, tap, first, weight);
    trapezoids_by<2>(from, to, begin, end, tap, first, weight);
}

Shadow shadow(const Geometry& geometry, const View& view, int z, int sub, Axis axis) {
    const Grid grid = geometry.seen_by(view);
    const bool x = axis == Axis::x;
    const double spacing = x ? grid.dx : grid.dy, edge = (x ? grid.x0 : grid.y0) - 0.5 * spacing;
    const double s = view.source[x ? 0 : 1], p0 = x ? view.left : view.low, pitch = x ? view.pa : view.pb;
    Shadow out;
    for (int face = 0; face < 2; face++) {
        const double down = grid.z0 + (z - 0.5 + double(sub + face) / view.subs) * grid.dz - view.source[2];
        const double magnification = (view.height - view.source[2]) / down;
        out.slope[face] = spacing * magnification / pitch;
        out.offset[face] = (s - p0 + (edge - s) * magnification) / pitch + 0.5;
    }
    return out;
}

void by_voxel(const Geometry& geometry, const View& view, int z, int product, Axis axis, AxisWeights& out) {
    const Grid grid = geometry.seen_by(view);
    const bool x = axis == Axis::x;
    const int sub = product / view.moments, moment = product % view.moments;
    const int n = x ? grid.nx : grid.ny, count = x ? view.na : view.nb;
    const double spacing = x ? grid.dx : grid.dy, edge = (x ? grid.x0 : grid.y0) - 0.5 * spacing;
    // The ray from the focal spot s through (x, z) meets the line of pixel centres p0 + a * pitch * (run, rise) where
    // a * pitch = cross(s - p0, d) / cross((run, rise), d), d = (x, z) - s.
    const double s = view.source[x ? 0 : 1], p0 = x ? view.left : view.low, pitch = x ? view.pa : view.pb;
    const double run = x ? view.run : 1, rise = x ? view.rise : 0, up = view.source[2] - view.height;
    std::vector<double> edges(2 *
                              size_t(n + 1)); // where they land at the two faces, counted so that pixel a is [a, a + 1]
    double *from = edges.data(), *to = from + n + 1;
    for (int face = 0; face < 2; face++) {
        const double dz = grid.z0 + (z - 0.5 + double(sub + face) / view.subs) * grid.dz - view.source[2];
        for (int i = 0; i <= n; i++) {
            const double dx = edge + i * spacing - s;
            edges[face * size_t(n + 1) + i] = ((s - p0) * dz - up * dx) / ((run * dz - rise * dx) * pitch) + 0.5;
        }
    }
    out.n = n;
    out.first.assign(n, 0);
    int taps = 1, begin = n, end = 0;
    for (int i = 0; i < n; i++) {
        const double low = std::max(0.0, std::min(from[i], to[i]));
        const double high = std::min(double(count), std::max(from[i + 1], to[i + 1]));
        if (!(low < high)) continue;
        begin = std::min(begin, i);
        end = i + 1;
        out.first[i] = int(low);
        taps = std::max(taps, int(std::ceil(high)) - int(low));
    }
    out.taps = taps;
    out.weight.assign(size_t(taps) * n, 0);
    // No tap leaves the panel: those before the shadow weigh nothing.
    for (int i = 0; i < n; i++) out.first[i] = std::min(out.first[i], count - taps);
    for (int t = 0; t < taps; t++)
        trapezoids(from, to, begin, end, t, moment, out.first.data(), &out.weight[size_t(t) * n]);
    if (!x && moment > 0)
        for (int t = 0; t < taps; t++)
            for (int i = 0; i < n; i++)
                if (view.calm(i)) out.weight[size_t(t) * n + i] = 0;
}

void by_pixel(const AxisWeights& voxels, int count, AxisWeights& out) {
    const int n = voxels.n;
    std::vector<int32_t> last(count, -1);
    out.n = count;
    out.first.assign(count, INT32_MAX);
    for (int t = 0; t < voxels.taps; t++)
        for (int i = 0; i < n; i++) {
            if (voxels.weight[size_t(t) * n + i] == 0) continue;
            const int a = voxels.first[i] + t;
            out.first[a] = std::min(out.first[a], i);
            last[a] = std::max(last[a], i);
        }
    out.taps = 1;
    for (int a = 0; a < count; a++)
        if (last[a] >= 0) out.taps = std::max(out.taps, last[a] - out.first[a] + 1);
    for (int32_t& i : out.first) i = std::min(i, n - out.taps);
    out.weight.assign(size_t(out.taps) * count, 0);
    for (int t = 0; t < voxels.taps; t++)
        for (int i = 0; i < n; i++) {
            const float w = voxels.weight[size_t(t) * n + i];
            if (w == 0) continue;
            const int a = voxels.first[i] + t;
            out.weight[size_t(i - out.first[a]) * count + a] = w;
        }
}

void rows(const Geometry& geometry, const View& view, int z, int sub, Rows& out) {
    const Grid grid = geometry.seen_by(view);
    const double thickness = grid.dz / view.subs;
    const double z1 = grid.z0 + (z - 0.5) * grid.dz + sub * thickness, z2 = z1 + thickness;
    const double s = view.source[1], edge = grid.y0 - 0.5 * grid.dy;
    for (auto* values : {&out.slope1, &out.offset1, &out.slope2, &out.offset2}) values->resize(view.na);
    double width = 0, narrow = 1e300, move = 0;
    for (int a = 0; a < view.na; a++) {
        const double up = view.source[2] - view.height - a * view.pa * view.rise;
        const double m1 = up / (view.source[2] - z1), m2 = up / (view.source[2] - z2);
        out.slope1[a] = grid.dy * m1 / view.pb;
        out.slope2[a] = grid.dy * m2 / view.pb;
        out.offset1[a] = (s + (edge - s) * m1 - view.low) / view.pb;
        out.offset2[a] = (s + (edge - s) * m2 - view.low) / view.pb;
        width = std::max({width, out.slope1[a], out.slope2[a]});
        narrow = std::min({narrow, out.slope1[a], out.slope2[a]});
        for (int y : {0, grid.ny})
            move = std::max(move, std::fabs((out.slope2[a] - out.slope1[a]) * y + out.offset2[a] - out.offset1[a]));
    }
    out.taps = int(std::ceil(width + move)) + 1;
    out.voxels = int(std::ceil((1 + move) / narrow)) + 1;
}

} // namespace palpate
