#include "statistics/mrf_prior_row.h"
#include "base/simd.h"
#include <algorithm>

namespace palpate {
namespace {

// A neighbouring row, and the weights of its voxels at x - 1, x and x + 1.
struct NeighbourRow {
    const float* row;
    float before, at, after;
};

constexpr int row_count = 9;

// The neighbouring rows, in opposite pairs; outside the volume the voxels' own row with weight 0. The last is their own
// row.
void find_neighbour_rows(const Neighbourhood& n, const float* row, int64_t z, int64_t y, bool backwards,
                         NeighbourRow* out) {
    const int steps[row_count][2] = {{0, -1}, {0, 1}, {-1, -1}, {1, 1}, {-1, 0}, {1, 0}, {-1, 1}, {1, -1}, {0, 0}};
    for (int i = 0; i < row_count; i++) {
        const int dz = steps[i][0], dy = steps[i][1];
        const float* w = n.weight[dz + 1][dy + 1];
        const bool inside = z + dz >= 0 && z + dz < n.nz && y + dy >= 0 && y + dy < n.ny;
        if (i == row_count - 1)
            out[i] = {row, backwards ? w[0] : 0, 0, backwards ? 0 : w[2]};
        else if (inside)
            out[i] = {row + (dz * n.ny + dy) * n.nx, w[0], w[1], w[2]};
        else
            out[i] = {row, 0, 0, 0};
    }
}

// Two pairs of voxels of Lange's potential, with one division. slope: Σ weight · t / (edge + |t|); curvature: Σ weight
// / (edge + |t|).
PALPATE_INLINE void add_two(const f32x8& f, const float* first, float first_weight, const float* second,
                            float second_weight, float edge, f32x8& slope, f32x8& curvature) {
    f32x8 t, u, a, b;
    load(t, first);
    load(u, second);
    t = f - t;
    u = f - u;
    magnitude(t, a);
    magnitude(u, b);
    a += edge;
    b += edge;
    const f32x8 inverse = 1 / (a * b);
    b *= first_weight * inverse;
    a *= second_weight * inverse;
    slope += b * t + a * u;
    curvature += a + b;
}

PALPATE_INLINE void add_one(const f32x8& f, const float* other, float weight, float edge, f32x8& slope,
                            f32x8& curvature) {
    f32x8 t, a;
    load(t, other);
    t = f - t;
    magnitude(t, a);
    const f32x8 k = weight / (a + edge);
    slope += k * t;
    curvature += k;
}

// Eight voxels from x on, none of them at either end of the row.
PALPATE_INLINE void lange_at(const NeighbourRow* rows, float edge, int64_t x, float* slope, float* curvature) {
    const float* own = rows[row_count - 1].row + x;
    f32x8 f, slope_sum = {}, curvature_sum = {};
    load(f, own);
    for (int i = 0; i + 1 < row_count; i++)
        add_two(f, rows[i].row + x - 1, rows[i].before, rows[i].row + x + 1, rows[i].after, edge, slope_sum,
                curvature_sum);
    for (int i = 0; i + 1 < row_count; i += 2)
        add_two(f, rows[i].row + x, rows[i].at, rows[i + 1].row + x, rows[i + 1].at, edge, slope_sum, curvature_sum);
    const NeighbourRow& last = rows[row_count - 1];
    if (last.before > 0)
        add_one(f, own - 1, last.before, edge, slope_sum, curvature_sum);
    else
        add_one(f, own + 1, last.after, edge, slope_sum, curvature_sum);
    slope_sum *= edge;
    curvature_sum *= edge;
    store(slope, slope_sum);
    store(curvature, curvature_sum);
}

template <Potential potential>
PALPATE_INLINE void add_voxel(const PotentialParameters& law, float t, float weight, float& slope, float& curvature) {
    const float k = weight * potential_curvature<potential>(law, t);
    slope += k * t;
    curvature += k;
}

// One voxel.
template <Potential potential>
PALPATE_INLINE void one_at(const NeighbourRow* rows, const PotentialParameters& law, int64_t x, int64_t nx,
                           float* slope, float* curvature) {
    const float f = rows[row_count - 1].row[x];
    float slope_sum = 0, curvature_sum = 0;
    for (int i = 0; i < row_count; i++) {
        const float* row = rows[i].row + x;
        if (x > 0) add_voxel<potential>(law, f - row[-1], rows[i].before, slope_sum, curvature_sum);
        add_voxel<potential>(law, f - row[0], rows[i].at, slope_sum, curvature_sum);
        if (x + 1 < nx) add_voxel<potential>(law, f - row[1], rows[i].after, slope_sum, curvature_sum);
    }
    *slope = slope_sum;
    *curvature = curvature_sum;
}

PALPATE_KERNEL void lange_row(const NeighbourRow* rows, const PotentialParameters& law, int64_t begin, int64_t end,
                              int64_t nx, float* slope, float* curvature) {
    int64_t x = std::max<int64_t>(begin, 1);
    const int64_t last = std::min(end, nx - 1);
    slope -= begin, curvature -= begin;
    if (last - x < lanes) {
        for (x = begin; x < end; x++) one_at<Potential::lange>(rows, law, x, nx, slope + x, curvature + x);
        return;
    }
    if (begin < x) one_at<Potential::lange>(rows, law, begin, nx, slope + begin, curvature + begin);
    if (last < end) one_at<Potential::lange>(rows, law, last, nx, slope + last, curvature + last);
    for (; x + lanes <= last; x += lanes) lange_at(rows, law.edge, x, slope + x, curvature + x);
    if (x < last)
        lange_at(rows, law.edge, last - lanes, slope + last - lanes, curvature + last - lanes); // some voxels twice
}

} // namespace

void prior_of_row(const Neighbourhood& n, const float* f, int64_t z, int64_t y, int64_t begin, int64_t end,
                  bool backwards, float* slope, float* curvature) {
    const float* row = f + (z * n.ny + y) * n.nx;
    if (n.law.potential == Potential::lange) {
        NeighbourRow rows[row_count];
        find_neighbour_rows(n, row, z, y, backwards, rows);
        lange_row(rows, n.law, begin, end, n.nx, slope, curvature);
        return leave_out_border(n, row, z, y, begin, end, slope, curvature);
    }
    prior_across_rows(n, f, z, y, begin, end, slope, curvature);
    for (int64_t x = begin; x < end; x++) {
        const int64_t other = backwards ? x - 1 : x + 1;
        if (other < 0 || other >= n.nx) continue;
        const float t = row[x] - row[other];
        const float k = n.weight[1][1][backwards ? 0 : 2] * potential_curvature(n.law, t);
        slope[x - begin] += k * t;
        curvature[x - begin] += k;
    }
    leave_out_border(n, row, z, y, begin, end, slope, curvature);
}

} // namespace palpate
