#include "weights.h"
#include "dispatch.h"
#include <algorithm>
#include <cmath>

namespace palpate {

// The edges of voxels of a sub-slice along one axis when the ray is at its one face (from) and the other (to), counted
// so that pixel a is [a, a + 1]: where their low [0] and their high [1] edges land.
struct Landed {
    const double *from[2], *to[2];
    bool at_low, at_high; // whether the first voxel's low edge is the volume's own face, and the last one's high edge
};

// weight[i] = sum of share[m] times moment m of the part of pixel first[i] + tap between the two edges of voxel i.
template <int moments>
PALPATE_INLINE void trapezoids_by(const Landed& edges, int begin, int end, int tap, int n, double per_trim,
                                  const double* __restrict share, const int32_t* __restrict first,
                                  float* __restrict weight) {
    const int low_face = edges.at_low ? 0 : -1, high_face = edges.at_high ? n - 1 : -1;
    const double* __restrict low_from = edges.from[0], * __restrict high_from = edges.from[1];
    const double* __restrict low_to = edges.to[0], * __restrict high_to = edges.to[1];
    for (int i = begin; i < end; i++) {
        const double q = first[i] + tap;
        double left[moments], right[moments], w = 0;
        cover(low_from[i] - q, low_to[i] - q, moments, i == low_face ? untrimmed : per_trim, left);
        cover(high_from[i] - q, high_to[i] - q, moments, i == high_face ? untrimmed : per_trim, right);
        for (int m = 0; m < moments; m++) w += share[m] * (right[m] - left[m]);
        weight[i] = std::fabs(w) > 1e-7 ? float(w) : 0.0f; // rounding must not tie a voxel to pixels it does not reach
    }
}

PALPATE_KERNEL void trapezoids(const Landed& edges, int begin, int end, int tap, int n, int moments, double per_trim,
                               const double* share, const int32_t* first, float* weight) {
    if (moments == 1) return trapezoids_by<1>(edges, begin, end, tap, n, per_trim, share, first, weight);
    if (moments == 2) return trapezoids_by<2>(edges, begin, end, tap, n, per_trim, share, first, weight);
    trapezoids_by<3>(edges, begin, end, tap, n, per_trim, share, first, weight);
}

Node gauss(int count, int index) {
    const double side = count == 1 ? 0 : count == 2 ? std::sqrt(1.0 / 3) : std::sqrt(0.6);
    const double u = count == 2 ? (index ? side : -side) : (index - (count - 1) / 2) * side; // on [-1, 1]
    const double weight = count == 1 ? 1 : count == 2 ? 0.5 : index == 1 ? 8.0 / 18 : 5.0 / 18;
    return {0.5 + 0.5 * u, {weight, weight * std::sqrt(3.0) * u, weight * std::sqrt(5.0) * (1.5 * u * u - 0.5)}};
}

Shadow shadow(const Geometry& geometry, const View& view, int z, int sub, Axis axis) {
    const Grid grid = geometry.seen_by(view);
    const bool x = axis == Axis::x;
    const double spacing = x ? grid.dx : grid.dy, edge = (x ? grid.x0 : grid.y0) - 0.5 * spacing;
    const double s = view.source[x ? 0 : 1], p0 = x ? view.left : view.low, pitch = x ? view.pa : view.pb;
    Shadow out;
    out.trim = view.trim;
    for (int face = 0; face < 2; face++) {
        const double down = grid.z0 + (z - 0.5 + double(sub + face) / view.subs) * grid.dz - view.source[2];
        const double magnification = (view.height - view.source[2]) / down;
        out.slope[face] = spacing * magnification / pitch;
        out.offset[face] = (s - p0 + (edge - s) * magnification) / pitch + 0.5;
    }
    return out;
}

// Of `n` voxels, all of them where `voxels` is null.
static void weigh_along(const Geometry& geometry, const View& view, int z, int product, Axis axis, const int* voxels,
                        int n, AxisWeights& out) {
    const Grid grid = geometry.seen_by(view);
    const bool x = axis == Axis::x;
    const int sub = product / view.moments, moment = product % view.moments;
    const bool turned = view.pose == Pose::turned;
    const Node node = turned ? gauss(view.moments, moment) : Node{};
    const int all = x ? grid.nx : grid.ny, count = x ? view.na : view.nb;
    const double spacing = x ? grid.dx : grid.dy, edge = (x ? grid.x0 : grid.y0) - 0.5 * spacing;
    // The ray from the focal spot s through (x, z) meets the line of pixel centres p0 + a * pitch * (run, rise) where
    // a * pitch = cross(s - p0, d) / cross((run, rise), d), d = (x, z) - s.
    const double s = view.source[x ? 0 : 1], p0 = x ? view.left : view.low, pitch = x ? view.pa : view.pb;
    const double run = x ? view.run : 1, rise = x ? view.rise : 0, up = view.source[2] - view.height;
    const int ends =
        voxels ? 2 * n : n + 1; // low edges, then high ones; of all voxels one's high edge is the next's low
    std::vector<double> landed(2 * size_t(ends));
    for (int face = 0; face < 2; face++) {
        const double at = sub + (turned && !x ? node.at : face); // in sub-slices
        const double dz = grid.z0 + (z - 0.5 + at / view.subs) * grid.dz - view.source[2];
        for (int i = 0; i < ends; i++) {
            const double dx = edge + (voxels ? voxels[i % n] + i / n : i) * spacing - s;
            landed[face * size_t(ends) + i] = ((s - p0) * dz - up * dx) / ((run * dz - rise * dx) * pitch) + 0.5;
        }
    }
    const double *from = landed.data(), *to = from + ends, *high_from = from + (voxels ? n : 1),
                 *high_to = to + (voxels ? n : 1);
    const Landed edges{
        {from, high_from}, {to, high_to}, !voxels || voxels[0] == 0, !voxels || voxels[n - 1] == all - 1};
    out.n = n;
    out.first.assign(n, 0);
    int taps = 1, begin = n, end = 0;
    for (int i = 0; i < n; i++) {
        const double low = std::max(0.0, std::min(from[i], to[i]));
        const double high = std::min(double(count), std::max(high_from[i], high_to[i]));
        if (!(low < high)) continue;
        begin = std::min(begin, i);
        end = i + 1;
        out.first[i] = int(low);
        taps = std::max(taps, int(std::ceil(high)) - int(low));
    }
    out.taps = taps;
    out.weight.assign(size_t(taps) * n, 0);
    double share[most_moments] = {};
    int moments = moment + 1;
    share[moment] = 1;
    if (turned) {
        moments = x ? view.moments : 1;
        for (int m = 0; m < moments; m++) share[m] = x ? node.share[m] : 1;
    }
    // No tap leaves the panel: those before the shadow weigh nothing.
    for (int i = 0; i < n; i++) out.first[i] = std::min(out.first[i], count - taps);
    for (int t = 0; t < taps; t++)
        trapezoids(edges, begin, end, t, n, moments, per(view.trim), share, out.first.data(),
                   &out.weight[size_t(t) * n]);
    if (!x && moment > 0 && !turned)
        for (int t = 0; t < taps; t++)
            for (int i = 0; i < n; i++)
                if (view.calm(voxels ? voxels[i] : i, moment)) out.weight[size_t(t) * n + i] = 0;
}

void by_voxel(const Geometry& geometry, const View& view, int z, int product, Axis axis, AxisWeights& out) {
    const Grid grid = geometry.seen_by(view);
    weigh_along(geometry, view, z, product, axis, nullptr, axis == Axis::x ? grid.nx : grid.ny, out);
}

void by_voxel(const Geometry& geometry, const View& view, int z, int product, Axis axis, const std::vector<int>& voxels,
              AxisWeights& out) {
    weigh_along(geometry, view, z, product, axis, voxels.data(), int(voxels.size()), out);
}

Edges edges(const Geometry& geometry, const View& view, int z, int product) {
    const Grid grid = geometry.seen_by(view);
    const double at = product / view.moments + gauss(view.moments, product % view.moments).at;
    const double down = view.source[2] - (grid.z0 + (z - 0.5 + at / view.subs) * grid.dz);
    const double s = view.source[1], edge = grid.y0 - 0.5 * grid.dy;
    const double m = (view.source[2] - view.height) / down, step = -view.pa * view.rise / down; // the magnification
    return {grid.dy * m / view.pb, (s + (edge - s) * m - view.low) / view.pb + 0.5, grid.dy * step / view.pb,
            (edge - s) * step / view.pb};
}

} // namespace palpate
