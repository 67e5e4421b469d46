#include "weights.h"
#include <algorithm>
#include <cmath>

namespace palpate {

void by_voxel(const Geometry& geometry, const View& view, int z, int sub, Axis axis, AxisWeights& out) {
    const Grid grid = geometry.seen_by(view);
    const bool x = axis == Axis::x;
    const int n = x ? grid.nx : grid.ny, count = x ? view.na : view.nb;
    const double spacing = x ? grid.dx : grid.dy, origin = x ? grid.x0 : grid.y0;
    const double thickness = grid.dz / view.subs;
    const double z1 = grid.z0 + (z - 0.5) * grid.dz + sub * thickness, z2 = z1 + thickness;
    // The ray from the focal spot s through (x, z) meets the line of pixel centres p0 + a * pitch * (run, rise) where
    // a * pitch = cross(s - p0, d) / cross((run, rise), d), d = (x, z) - s.
    const double s = view.source[x ? 0 : 1], p0 = x ? view.left : view.low, pitch = x ? view.pa : view.pb;
    const double run = x ? view.run : 1, rise = x ? view.rise : 0, up = view.source[2] - view.height;
    auto landed = [&](double height, int i) {
        const double dx = origin + (i - 0.5) * spacing - s, dz = height - view.source[2];
        return ((s - p0) * dz - up * dx) / (run * dz - rise * dx) / pitch;
    };

    // Wide enough for any voxel: the widest shadow, and how far the farthest edge moves.
    double width = 0, move = 0;
    for (int i : {0, n}) move = std::max(move, std::fabs(landed(z2, i) - landed(z1, i)));
    for (int i : {0, n - 1})
        for (double h : {z1, z2}) width = std::max(width, std::fabs(landed(h, i + 1) - landed(h, i)));
    const int taps = int(std::ceil(width + move)) + 2;
    out.n = n;
    out.first.assign(n, 0);
    out.weight.assign(size_t(taps) * n, 0);
    int used = 1;
    for (int i = 0; i < n; i++) {
        const double l1 = landed(z1, i), l2 = landed(z2, i), r1 = landed(z1, i + 1), r2 = landed(z2, i + 1);
        const int low = std::max(0, int(std::floor(std::min(l1, l2) + 0.5)));
        const int high = std::min(count - 1, int(std::floor(std::max(r1, r2) + 0.5)));
        if (high < low) continue;
        out.first[i] = low;
        for (int a = low; a <= high && a - low < taps; a++) {
            out.weight[size_t(a - low) * n + i] = float(covered(r1, r2, a - 0.5) - covered(l1, l2, a - 0.5));
            used = std::max(used, a - low + 1);
        }
    }
    out.taps = used;
    out.weight.resize(size_t(used) * n);
}

void by_pixel(const AxisWeights& voxels, int count, AxisWeights& out) {
    std::vector<int32_t> last(count, -1);
    out.n = count;
    out.first.assign(count, 0);
    for (int i = 0; i < voxels.n; i++)
        for (int t = 0; t < voxels.taps; t++) {
            if (voxels.weight[size_t(t) * voxels.n + i] == 0) continue;
            int a = voxels.first[i] + t;
            if (last[a] < 0) out.first[a] = i;
            last[a] = i;
        }
    out.taps = 1;
    for (int a = 0; a < count; a++) out.taps = std::max(out.taps, last[a] - out.first[a] + 1);
    out.weight.assign(size_t(out.taps) * count, 0);
    for (int i = 0; i < voxels.n; i++)
        for (int t = 0; t < voxels.taps; t++) {
            float w = voxels.weight[size_t(t) * voxels.n + i];
            if (w == 0) continue;
            int a = voxels.first[i] + t;
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
