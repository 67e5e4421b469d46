#include "across.h"
#include "lanes.h"
#include <algorithm>

namespace palpate {
namespace {

// A row beside or above ours, and the weights of its voxels before, at and behind ours.
struct Beside {
    const float* row;
    float before, at, behind;
};

constexpr int most = 9;

// The rows around, in pairs that face each other; where there is none, our own with weight 0. The last is our own.
void rows_around(const Neighbourhood& n, const float* row, int64_t z, int64_t y, bool backwards, Beside* out) {
    const int steps[most][2] = {{0, -1}, {0, 1}, {-1, -1}, {1, 1}, {-1, 0}, {1, 0}, {-1, 1}, {1, -1}, {0, 0}};
    for (int i = 0; i < most; i++) {
        const int dz = steps[i][0], dy = steps[i][1];
        const float* w = n.weight[dz + 1][dy + 1];
        const bool there = z + dz >= 0 && z + dz < n.nz && y + dy >= 0 && y + dy < n.ny;
        if (i == most - 1)
            out[i] = {row, backwards ? w[0] : 0, 0, backwards ? 0 : w[2]};
        else if (there)
            out[i] = {row + (dz * n.ny + dy) * n.nx, w[0], w[1], w[2]};
        else
            out[i] = {row, 0, 0, 0};
    }
}

// Two pairs of voxels of Lange's prior, with one division. push: Σ weight · t / (edge + |t|); pull: Σ weight / (edge +
// |t|).
PALPATE_INLINE void add_two(const Lanes& f, const float* first, float first_weight, const float* second,
                            float second_weight, float edge, Lanes& push, Lanes& pull) {
    Lanes t, u, a, b;
    load(t, first);
    load(u, second);
    t = f - t;
    u = f - u;
    magnitude(t, a);
    magnitude(u, b);
    a += edge;
    b += edge;
    const Lanes inverse = 1 / (a * b);
    b *= first_weight * inverse;
    a *= second_weight * inverse;
    push += b * t + a * u;
    pull += a + b;
}

PALPATE_INLINE void add_one(const Lanes& f, const float* other, float weight, float edge, Lanes& push, Lanes& pull) {
    Lanes t, a;
    load(t, other);
    t = f - t;
    magnitude(t, a);
    const Lanes k = weight / (a + edge);
    push += k * t;
    pull += k;
}

// Eight voxels from x on, none of them at either end of the row.
PALPATE_INLINE void lange_at(const Beside* rows, float edge, int64_t x, float* slope, float* curvature) {
    const float* own = rows[most - 1].row + x;
    Lanes f, push = {}, pull = {};
    load(f, own);
    for (int i = 0; i + 1 < most; i++)
        add_two(f, rows[i].row + x - 1, rows[i].before, rows[i].row + x + 1, rows[i].behind, edge, push, pull);
    for (int i = 0; i + 1 < most; i += 2)
        add_two(f, rows[i].row + x, rows[i].at, rows[i + 1].row + x, rows[i + 1].at, edge, push, pull);
    const Beside& last = rows[most - 1];
    if (last.before > 0)
        add_one(f, own - 1, last.before, edge, push, pull);
    else
        add_one(f, own + 1, last.behind, edge, push, pull);
    push *= edge;
    pull *= edge;
    store(slope, push);
    store(curvature, pull);
}

template <Potential potential>
PALPATE_INLINE void add_voxel(const Law& law, float t, float weight, float& slope, float& curvature) {
    const float k = weight * potential_curvature<potential>(law, t);
    slope += k * t;
    curvature += k;
}

// One voxel.
template <Potential potential>
PALPATE_INLINE void one_at(const Beside* rows, const Law& law, int64_t x, int64_t nx, float* slope, float* curvature) {
    const float f = rows[most - 1].row[x];
    float push = 0, pull = 0;
    for (int i = 0; i < most; i++) {
        const float* row = rows[i].row + x;
        if (x > 0) add_voxel<potential>(law, f - row[-1], rows[i].before, push, pull);
        add_voxel<potential>(law, f - row[0], rows[i].at, push, pull);
        if (x + 1 < nx) add_voxel<potential>(law, f - row[1], rows[i].behind, push, pull);
    }
    *slope = push;
    *curvature = pull;
}

PALPATE_KERNEL void lange_row(const Beside* rows, const Law& law, int64_t begin, int64_t end, int64_t nx, float* slope,
                              float* curvature) {
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
    if (x < last) lange_at(rows, law.edge, last - lanes, slope + last - lanes, curvature + last - lanes); // some again
}

} // namespace

void prior_of_row(const Neighbourhood& n, const float* f, int64_t z, int64_t y, int64_t begin, int64_t end,
                  bool backwards, float* slope, float* curvature) {
    const float* row = f + (z * n.ny + y) * n.nx;
    if (n.law.potential == Potential::lange) {
        Beside rows[most];
        rows_around(n, row, z, y, backwards, rows);
        return lange_row(rows, n.law, begin, end, n.nx, slope, curvature);
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
}

} // namespace palpate
