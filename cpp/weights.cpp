#include "weights.h"
#include "dispatch.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// Antiderivative of t -> clamp(t, 0, 1), without branches.
PALPATE_INLINE double rise(double t) {
    const double c = t < 0 ? 0 : t > 1 ? 1 : t;
    return 0.5 * c * c + (t > 1 ? t - 1 : 0);
}

// Mean of clamp(p - q, 0, 1) while p moves on by `move`: the part of the pixel [q, q + 1] left of an edge that moves
// while the ray crosses the sub-slice.
PALPATE_INLINE double covered(double p, double move, double q) {
    const bool still = move < 1e-7 && move > -1e-7; // the quotient is 0 / 0; the middle is exact to 1e-8
    double c = p + 0.5 * move - q;
    c = c < 0 ? 0 : c > 1 ? 1 : c;
    const double mean = (rise(p + move - q) - rise(p - q)) / (still ? 1 : move);
    return still ? c : mean;
}

// Edge i lies at from + i * from_step when the ray enters the sub-slice and at to + i * to_step when it leaves.
struct Edges {
    double from, from_step, to, to_step;
};

} // namespace

PALPATE_KERNEL void trapezoids(const double* edges, int n, int tap, const int32_t* __restrict first,
                               float* __restrict weight) {
    const double from = edges[0], from_step = edges[1], move = edges[2] - from, move_step = edges[3] - from_step;
    for (int i = 0; i < n; i++) {
        const double q = first[i] + tap;
        const double right = covered(from + (i + 1) * from_step, move + (i + 1) * move_step, q);
        const double w = right - covered(from + i * from_step, move + i * move_step, q);
        weight[i] = w > 1e-9 ? float(w) : 0.0f; // rounding must not tie a voxel to pixels that it does not reach
    }
}

void by_voxel(const Geometry& geometry, const View& view, int z, int sub, Axis axis, AxisWeights& out) {
    const Grid& grid = geometry.grid;
    const bool x = axis == Axis::x;
    const int n = x ? grid.nx : grid.ny, count = x ? view.na : view.nb;
    const double spacing = x ? grid.dx : grid.dy, edge = (x ? grid.x0 : grid.y0) - 0.5 * spacing;
    const double pitch = x ? view.pa : view.pb, left = (x ? view.left : view.low) - 0.5 * pitch;
    const double s = view.source[x ? 0 : 1];
    auto magnify = [&](int part) { // at the faces of the sub-slice
        const double face = grid.z0 + (z - 0.5 + double(part) / view.subs) * grid.dz;
        return (view.source[2] - view.height) / (view.source[2] - face);
    };
    const double m1 = magnify(sub), m2 = magnify(sub + 1);
    // Pixel a is [a, a + 1] here.
    const Edges e{(s + (edge - s) * m1 - left) / pitch, spacing * m1 / pitch, (s + (edge - s) * m2 - left) / pitch,
                  spacing * m2 / pitch};
    out.n = n;
    out.first.resize(n);
    int taps = 1;
    for (int i = 0; i < n; i++) {
        const double low = std::max(0.0, std::min(e.from + i * e.from_step, e.to + i * e.to_step));
        const double high =
            std::min(double(count), std::max(e.from + (i + 1) * e.from_step, e.to + (i + 1) * e.to_step));
        out.first[i] = low < count ? int(low) : count - 1;
        if (low < high) taps = std::max(taps, int(std::ceil(high)) - int(low));
    }
    out.taps = taps;
    out.weight.resize(size_t(taps) * n);
    // No tap leaves the panel: those before the shadow weigh nothing.
    for (int i = 0; i < n; i++) out.first[i] = std::min(out.first[i], count - taps);
    for (int t = 0; t < taps; t++) trapezoids(&e.from, n, t, out.first.data(), &out.weight[size_t(t) * n]);
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

} // namespace palpate
