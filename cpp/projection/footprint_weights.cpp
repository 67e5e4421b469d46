#include "projection/footprint_weights.h"
#include "base/cpu_dispatch.h"
#include <algorithm>
#include <cmath>

namespace palpate {

// The edges of voxels of a sub-slice along one axis when the ray is at its one face (from) and the other (to), counted
// so that pixel a is [a, a + 1]: where their low [0] and their high [1] edges land.
struct EdgePositions {
    const double *from[2], *to[2];
    bool at_low, at_high; // whether the first voxel's low edge is the volume's own face, and the last one's high edge
};

// weight[i] = sum of share[m] times moment m of the part of pixel first[i] + tap between the two edges of voxel i.
template <int moments>
PALPATE_INLINE void trapezoid_weights_by(const EdgePositions& edges, int begin, int end, int tap, int n,
                                         double per_truncation, const double* __restrict coefficient,
                                         const int32_t* __restrict first, float* __restrict weight) {
    const int low_face = edges.at_low ? 0 : -1, high_face = edges.at_high ? n - 1 : -1;
    const double* __restrict low_from = edges.from[0], * __restrict high_from = edges.from[1];
    const double* __restrict low_to = edges.to[0], * __restrict high_to = edges.to[1];
    for (int i = begin; i < end; i++) {
        const double q = first[i] + tap;
        double left[moments], right[moments], w = 0;
        legendre_moments(low_from[i] - q, low_to[i] - q, moments, i == low_face ? no_truncation : per_truncation, left);
        legendre_moments(high_from[i] - q, high_to[i] - q, moments, i == high_face ? no_truncation : per_truncation,
                         right);
        for (int m = 0; m < moments; m++) w += coefficient[m] * (right[m] - left[m]);
        weight[i] = std::fabs(w) > 1e-7 ? float(w) : 0.0f; // rounding must not tie a voxel to pixels it does not reach
    }
}

PALPATE_KERNEL void trapezoid_weights(const EdgePositions& edges, int begin, int end, int tap, int n, int moments,
                                      double per_truncation, const double* coefficient, const int32_t* first,
                                      float* weight) {
    if (moments == 1)
        return trapezoid_weights_by<1>(edges, begin, end, tap, n, per_truncation, coefficient, first, weight);
    if (moments == 2)
        return trapezoid_weights_by<2>(edges, begin, end, tap, n, per_truncation, coefficient, first, weight);
    trapezoid_weights_by<3>(edges, begin, end, tap, n, per_truncation, coefficient, first, weight);
}

GaussPoint gauss_point(int count, int index) {
    const double side = count == 1 ? 0 : count == 2 ? std::sqrt(1.0 / 3) : std::sqrt(0.6);
    const double u = count == 2 ? (index ? side : -side) : (index - (count - 1) / 2) * side; // on [-1, 1]
    const double weight = count == 1 ? 1 : count == 2 ? 0.5 : index == 1 ? 8.0 / 18 : 5.0 / 18;
    return {0.5 + 0.5 * u, {weight, weight * std::sqrt(3.0) * u, weight * std::sqrt(5.0) * (1.5 * u * u - 0.5)}};
}

EdgeProjection project_edges(const ScanGeometry& geometry, const View& view, int z, int sub, Axis axis) {
    const Grid grid = geometry.seen_by(view);
    const bool x = axis == Axis::x;
    const double spacing = x ? grid.dx : grid.dy, edge = (x ? grid.x0 : grid.y0) - 0.5 * spacing;
    const double s = view.source[x ? 0 : 1], p0 = x ? view.first_x : view.first_y,
                 pitch = x ? view.pitch_a : view.pitch_b;
    EdgeProjection out;
    out.truncation = view.truncation;
    for (int face = 0; face < 2; face++) {
        const double down = grid.z0 + (z - 0.5 + double(sub + face) / view.subslices) * grid.dz - view.source[2];
        const double magnification = (view.first_z - view.source[2]) / down;
        out.slope[face] = spacing * magnification / pitch;
        out.offset[face] = (s - p0 + (edge - s) * magnification) / pitch + 0.5;
    }
    return out;
}

// Of `n` voxels, all of them where `voxels` is null.
static void make_axis_weights(const ScanGeometry& geometry, const View& view, int z, int product, Axis axis,
                              const int* voxels, int n, AxisWeights& out) {
    const Grid grid = geometry.seen_by(view);
    const bool x = axis == Axis::x;
    const int sub = product / view.moments, moment = product % view.moments;
    const bool rotated = view.orientation == PanelOrientation::rotated;
    const GaussPoint node = rotated ? gauss_point(view.moments, moment) : GaussPoint{};
    const int all = x ? grid.nx : grid.ny, count = x ? view.na : view.nb;
    const double spacing = x ? grid.dx : grid.dy, edge = (x ? grid.x0 : grid.y0) - 0.5 * spacing;
    // The ray from the focal spot s through (x, z) meets the line of pixel centres p0 + a * pitch * (axis_x, axis_z)
    // where a * pitch = cross(s - p0, d) / cross((axis_x, axis_z), d), d = (x, z) - s.
    const double s = view.source[x ? 0 : 1], p0 = x ? view.first_x : view.first_y,
                 pitch = x ? view.pitch_a : view.pitch_b;
    const double axis_x = x ? view.axis_x : 1, axis_z = x ? view.axis_z : 0, up = view.source[2] - view.first_z;
    const int ends =
        voxels ? 2 * n : n + 1; // low edges, then high ones; of all voxels one's high edge is the next's low
    std::vector<double> positions(2 * size_t(ends));
    for (int face = 0; face < 2; face++) {
        const double at = sub + (rotated && !x ? node.at : face); // in sub-slices
        const double dz = grid.z0 + (z - 0.5 + at / view.subslices) * grid.dz - view.source[2];
        for (int i = 0; i < ends; i++) {
            const double dx = edge + (voxels ? voxels[i % n] + i / n : i) * spacing - s;
            positions[face * size_t(ends) + i] =
                ((s - p0) * dz - up * dx) / ((axis_x * dz - axis_z * dx) * pitch) + 0.5;
        }
    }
    const double *from = positions.data(), *to = from + ends, *high_from = from + (voxels ? n : 1),
                 *high_to = to + (voxels ? n : 1);
    const EdgePositions edges{
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
    double coefficient[max_moments] = {};
    int moments = moment + 1;
    coefficient[moment] = 1;
    if (rotated) {
        moments = x ? view.moments : 1;
        for (int m = 0; m < moments; m++) coefficient[m] = x ? node.coefficient[m] : 1;
    }
    // No tap lies outside the panel: taps before the projection have weight 0.
    for (int i = 0; i < n; i++) out.first[i] = std::min(out.first[i], count - taps);
    for (int t = 0; t < taps; t++)
        trapezoid_weights(edges, begin, end, t, n, moments, inverse_truncation(view.truncation), coefficient,
                          out.first.data(), &out.weight[size_t(t) * n]);
    if (!x && moment > 0 && !rotated)
        for (int t = 0; t < taps; t++)
            for (int i = 0; i < n; i++)
                if (view.moments_suffice(voxels ? voxels[i] : i, moment)) out.weight[size_t(t) * n + i] = 0;
}

void voxel_weights(const ScanGeometry& geometry, const View& view, int z, int product, Axis axis, AxisWeights& out) {
    const Grid grid = geometry.seen_by(view);
    make_axis_weights(geometry, view, z, product, axis, nullptr, axis == Axis::x ? grid.nx : grid.ny, out);
}

void voxel_weights(const ScanGeometry& geometry, const View& view, int z, int product, Axis axis,
                   const std::vector<int>& voxels, AxisWeights& out) {
    make_axis_weights(geometry, view, z, product, axis, voxels.data(), int(voxels.size()), out);
}

RowEdges row_edges(const ScanGeometry& geometry, const View& view, int z, int product) {
    const Grid grid = geometry.seen_by(view);
    const double at = product / view.moments + gauss_point(view.moments, product % view.moments).at;
    const double down = view.source[2] - (grid.z0 + (z - 0.5 + at / view.subslices) * grid.dz);
    const double s = view.source[1], edge = grid.y0 - 0.5 * grid.dy;
    const double m = (view.source[2] - view.first_z) / down,
                 step = -view.pitch_a * view.axis_z / down; // the magnification
    return {grid.dy * m / view.pitch_b, (s + (edge - s) * m - view.first_y) / view.pitch_b + 0.5,
            grid.dy * step / view.pitch_b, (edge - s) * step / view.pitch_b};
}

} // namespace palpate
