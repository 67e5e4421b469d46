#include "turned_rows.h"
#include "lanes.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// Rows under row y of voxels in each column of a turned panel, widening low and high. Numerical kernel.
PALPATE_KERNEL void column_bounds(const double* __restrict slope1, const double* __restrict offset1,
                                  const double* __restrict slope2, const double* __restrict offset2, int y, int nb,
                                  int na, int32_t* __restrict low, int32_t* __restrict high) {
    for (int a = 0; a < na; a++) {
        const double l1 = slope1[a] * y + offset1[a], l2 = slope2[a] * y + offset2[a];
        const double r1 = slope1[a] * (y + 1) + offset1[a], r2 = slope2[a] * (y + 1) + offset2[a];
        const double first = std::min(std::max(std::floor(std::min(l1, l2) + 0.5), 0.0), double(nb));
        const double last = std::max(std::min(std::floor(std::max(r1, r2) + 0.5), nb - 1.0), -1.0);
        low[a] = std::min(low[a], int32_t(first));
        high[a] = std::max(high[a], int32_t(last));
    }
}

// The same weights as Footprints gives a turned panel, for row y of voxels and all columns: weight[t * stride + a]
// belongs to row low[a] + t, which may lie beyond the image. One division an edge instead of one a tap. Numerical
// kernel.
PALPATE_KERNEL void column_taps(const double* __restrict slope1, const double* __restrict offset1,
                                const double* __restrict slope2, const double* __restrict offset2, int y, int taps,
                                int na, int64_t stride, const int32_t* __restrict low, double* __restrict per_move,
                                float* __restrict weight) {
    for (int a = 0; a < na; a++) {
        const double left = (slope2[a] - slope1[a]) * y + offset2[a] - offset1[a];
        const double right = (slope2[a] - slope1[a]) * (y + 1) + offset2[a] - offset1[a];
        per_move[a] = std::fabs(left) < 1e-6 ? 0 : 1 / left;
        per_move[na + a] = std::fabs(right) < 1e-6 ? 0 : 1 / right;
    }
    for (int t = 0; t < taps; t++)
        for (int a = 0; a < na; a++) {
            const double q = low[a] + t - 0.5;
            const double l1 = slope1[a] * y + offset1[a] - q, l2 = slope2[a] * y + offset2[a] - q;
            const double r1 = l1 + slope1[a], r2 = l2 + slope2[a];
            const double still_left = std::min(std::max(0.5 * (l1 + l2), 0.0), 1.0);
            const double still_right = std::min(std::max(0.5 * (r1 + r2), 0.0), 1.0);
            const double left = per_move[a] == 0 ? still_left : (rise(l2) - rise(l1)) * per_move[a];
            const double right = per_move[na + a] == 0 ? still_right : (rise(r2) - rise(r1)) * per_move[na + a];
            weight[t * stride + a] = float(right - left);
        }
}

// How far the edges of the rows move over the columns of one vector, in rows of the image.
double edges_drift(const std::vector<Rows>& edges, int ny, int na) {
    double most = 0;
    for (const Rows& e : edges)
        for (int y : {0, ny})
            for (int a = lanes; a < na; a++) {
                const int before = a - lanes;
                const double first = (e.slope1[a] - e.slope1[before]) * y + e.offset1[a] - e.offset1[before];
                const double second = (e.slope2[a] - e.slope2[before]) * y + e.offset2[a] - e.offset2[before];
                most = std::max({most, std::fabs(first), std::fabs(second)});
            }
    return most;
}

// The rows that the columns of a vector hold, if all begin in the same one; else 0.
PALPATE_INLINE int common_rows(const int32_t* low, const int32_t* high) {
    int last = high[0];
    bool same = true;
    for (int i = 1; i < lanes; i++) {
        same = same && low[i] == low[0];
        last = std::max(last, int(high[i]));
    }
    return same ? std::max(0, last - low[0] + 1) : 0;
}

// out = Σ over rows of weight · other · image; other: a second weight, or null. All at one vector of columns.
PALPATE_INLINE void reduce_columns(const int32_t* low, const int32_t* high, const float* weight, const float* other,
                                   int64_t step, const float* image, int64_t stride, float* out) {
    Lanes sum = {}, w, v, u;
    const int rows = common_rows(low, high);
    for (int t = 0; t < rows; t++) {
        load(w, weight + t * step);
        load(u, image + (low[0] + t) * stride);
        if (other) load(v, other + t * step), w *= v;
        sum += w * u;
    }
    store(out, sum);
    for (int i = 0; i < lanes && rows == 0; i++)
        for (int b = low[i]; b <= high[i]; b++) {
            const int64_t tap = (b - low[i]) * step + i;
            out[i] += weight[tap] * (other ? other[tap] : 1) * image[b * stride + i];
        }
}

PALPATE_KERNEL void reduce(const int32_t* low, const int32_t* high, const float* weight, const float* other,
                           int64_t step, const float* image, int64_t stride, int n, float* out) {
    for (int a = 0; a < n; a += lanes)
        reduce_columns(low + a, high + a, weight + a, other ? other + a : nullptr, step, image + a, stride, out + a);
}

PALPATE_KERNEL void expand(const int32_t* low, const int32_t* high, const float* weight, int64_t step,
                           const float* change, const float* curvature, int64_t stride, int n, float* slope) {
    for (int a = 0; a < n; a += lanes) {
        const int rows = common_rows(low + a, high + a);
        Lanes w, p, c, g;
        load(p, change + a);
        for (int t = 0; t < rows; t++) {
            const int64_t at = (low[a] + t) * stride + a;
            load(w, weight + t * step + a);
            load(c, curvature + at);
            load(g, slope + at);
            g += c * w * p;
            store(slope + at, g);
        }
        for (int i = a; i < a + lanes && rows == 0; i++)
            for (int b = low[i]; b <= high[i]; b++)
                slope[b * stride + i] += curvature[b * stride + i] * weight[(b - low[i]) * step + i] * change[i];
    }
}

} // namespace

void TurnedRow::make(const std::vector<Rows>& edges, int y, int nb, int na, int first, int last) {
    begin = first;
    end = last;
    const int n = end - begin, held = std::min(end, na) - begin;
    low.assign(n, 0); // no row beyond the last column
    high.assign(n, -1);
    std::fill_n(low.begin(), held, nb);
    for (const Rows& e : edges)
        column_bounds(&e.slope1[begin], &e.offset1[begin], &e.slope2[begin], &e.offset2[begin], y, nb, held, low.data(),
                      high.data());
    taps = 0;
    for (int a = 0; a < held; a++) taps = std::max(taps, high[a] - low[a] + 1);
    weight.resize(edges.size() * taps * n); // what lies beyond the columns is never read
    per_move.resize(2 * size_t(held));
    for (size_t i = 0; i < edges.size(); i++)
        column_taps(&edges[i].slope1[begin], &edges[i].offset1[begin], &edges[i].slope2[begin],
                    &edges[i].offset2[begin], y, taps, held, n, low.data(), per_move.data(),
                    weight.data() + i * taps * n);
}

void turned_reduce(const TurnedRow& row, const float* slope, const float* curvature, int64_t stride, int terms,
                   int from, int n, float* out, int64_t pitch) {
    const int64_t at = from - row.begin, step = row.end - row.begin, term = row.taps * step;
    const int32_t *low = row.low.data() + at, *high = row.high.data() + at;
    const float* weight = row.weight.data() + at;
    for (int m = 0; m < terms; m++, out += pitch)
        reduce(low, high, weight + m * term, nullptr, step, slope + from, stride, n, out);
    for (int m = 0; m < terms; m++)
        for (int k = m; k < terms; k++, out += pitch)
            reduce(low, high, weight + m * term, weight + k * term, step, curvature + from, stride, n, out);
}

void turned_expand(const TurnedRow& row, const float* change, int64_t pitch, const float* curvature, int64_t stride,
                   int terms, int from, int n, float* slope) {
    const int64_t at = from - row.begin, step = row.end - row.begin, term = row.taps * step;
    for (int m = 0; m < terms; m++)
        expand(row.low.data() + at, row.high.data() + at, row.weight.data() + m * term + at, step, change + m * pitch,
               curvature + from, stride, n, slope + from);
}

// In column a, row y of voxels covers up to max(l1, l2)(y + 1) and row y + apart begins at min(l1, l2)(y + apart): that
// gap is concave in y, so it is least at an end. Vectors are a few columns wide, over which both edges drift.
int turned_rows_apart(const std::vector<Rows>& edges, int ny, int na) {
    const double drift = edges_drift(edges, ny, na);
    for (int apart = 1; apart < ny; apart++) {
        double gap = 1e300;
        for (int a = 0; a < na; a++)
            for (int y : {0, ny - apart}) {
                double end = -1e300, begin = 1e300;
                for (const Rows& e : edges) {
                    end = std::max({end, e.slope1[a] * (y + 1) + e.offset1[a], e.slope2[a] * (y + 1) + e.offset2[a]});
                    begin = std::min(
                        {begin, e.slope1[a] * (y + apart) + e.offset1[a], e.slope2[a] * (y + apart) + e.offset2[a]});
                }
                gap = std::min(gap, begin - end);
            }
        if (gap > 1 + 2 * drift) return apart;
    }
    return ny;
}

} // namespace palpate
