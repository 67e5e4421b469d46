#include "weights.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// Antiderivative of t -> clamp(t, 0, 1).
inline double rise(double t) { return t <= 0 ? 0 : t < 1 ? 0.5 * t * t : t - 0.5; }

// Mean over p from p1 to p2 of clamp(p - q, 0, 1): the part of the pixel [q, q + 1] left of an edge that moves from p1
// to p2 while the ray crosses the sub-slice.
inline double covered(double p1, double p2, double q) {
    double move = p2 - p1;
    if (std::fabs(move) < 1e-7) return std::clamp(0.5 * (p1 + p2) - q, 0.0, 1.0);
    return (rise(p2 - q) - rise(p1 - q)) / move;
}

} // namespace

void by_voxel(const Geometry& geometry, const View& view, int z, int sub, Axis axis, AxisWeights& out) {
    const Grid& grid = geometry.grid;
    const bool x = axis == Axis::x;
    const int n = x ? grid.nx : grid.ny, count = x ? view.na : view.nb;
    const double spacing = x ? grid.dx : grid.dy, origin = x ? grid.x0 : grid.y0;
    const double s = view.source[x ? 0 : 1], left = x ? view.left : view.low, pitch = x ? view.pa : view.pb;
    const double thickness = grid.dz / view.subs;
    const double z1 = grid.z0 + (z - 0.5) * grid.dz + sub * thickness;
    const double m1 = (view.source[2] - view.height) / (view.source[2] - z1);
    const double m2 = (view.source[2] - view.height) / (view.source[2] - z1 - thickness);
    auto landed = [&](double m, int i) { return (s + (origin + (i - 0.5) * spacing - s) * m - left) / pitch; };

    // Wide enough for any voxel: its shadow at the top of the sub-slice, and how far the farthest edge moves.
    const double move = std::max(std::fabs(landed(m2, 0) - landed(m1, 0)), std::fabs(landed(m2, n) - landed(m1, n)));
    const int taps = int(std::ceil(spacing * std::max(m1, m2) / pitch + move)) + 2;
    out.n = n;
    out.first.assign(n, 0);
    out.weight.assign(size_t(taps) * n, 0);
    int used = 1;
    for (int i = 0; i < n; i++) {
        const double l1 = landed(m1, i), l2 = landed(m2, i), r1 = landed(m1, i + 1), r2 = landed(m2, i + 1);
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

} // namespace palpate
