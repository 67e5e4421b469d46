// The two passes of the projector on turned panels.
#include "turned_passes.h"

namespace palpate {
namespace {

// Per voxel, the pixels from out.first on; `own` of them have any weight.
void by_points(const Geometry& g, const View& v, int slab, std::vector<AxisWeights>& out, std::vector<int32_t>& own) {
    out.resize(v.moments);
    for (int m = 0; m < v.moments; m++) by_voxel(g, v, slab / v.subs, slab % v.subs * v.moments + m, Axis::x, out[m]);
    AxisWeights& axis = out[0]; // first and taps are those of all points
    const size_t n = axis.n;
    own.assign(n, 0);
    for (size_t i = 0; i < n; i++) {
        for (int t = axis.taps; t > 0 && own[i] == 0; t--)
            for (const AxisWeights& w : out)
                if (w.weight[(t - 1) * n + i] != 0) own[i] = t;
        if (i > 0) axis.first[i] = std::max(axis.first[i], axis.first[i - 1]); // beyond the panel
    }
}

// Blocks of weights 0, for elements of which i touches those of the source, 0 .. size, from first[i] to end[i].
void make_room(const std::vector<int32_t>& end, int points, int size, Table& out) {
    const int count = int(end.size()), blocks = (count + run - 1) / run;
    out.taps.assign(blocks, 0);
    for (int i = 0; i < count; i++) out.taps[i / run] = std::max(out.taps[i / run], end[i] - out.first[i]);
    for (int i = 0; i < count; i++) out.first[i] = std::min(out.first[i], size - out.taps[i / run]);
    out.first.resize(blocks * run, out.first[count - 1]);
    out.most = std::max(1, *std::max_element(out.taps.begin(), out.taps.end()));
    out.weight.assign(size_t(blocks) * points * out.most * run, 0.0f);
}

} // namespace

void under_columns(const Geometry& g, const View& v, int slab, Table& out) {
    std::vector<AxisWeights> voxels;
    std::vector<int32_t> end;
    by_points(g, v, slab, voxels, end);
    const int n = voxels[0].n;
    const std::vector<int32_t> first = voxels[0].first;
    out.first = first;
    for (int i = 0; i < n; i++) end[i] += first[i];
    make_room(end, v.moments, v.na, out);
    for (int i = 0; i < n; i++)
        for (int m = 0; m < v.moments; m++) {
            float* to = out.of(i, v.moments) + (int64_t(m) * out.taps_of(i) + first[i] - out.first[i]) * run;
            for (int t = 0; t < end[i] - first[i]; t++) to[t * run] = voxels[m].weight[size_t(t) * n + i];
        }
}

void over_columns(const Geometry& g, const View& v, int slab, Table& out) {
    std::vector<AxisWeights> voxels;
    std::vector<int32_t> own;
    by_points(g, v, slab, voxels, own);
    const std::vector<int32_t>& first = voxels[0].first;
    const int n = voxels[0].n;
    std::vector<int32_t> end(v.na);
    out.first.resize(v.na);
    int low = 0, high = 0;
    for (int a = 0; a < v.na; a++) {
        while (low < n && first[low] + own[low] <= a) low++;
        while (high < n && first[high] <= a) high++;
        out.first[a] = std::min(low, high);
        end[a] = high;
    }
    make_room(end, v.moments, n, out);
    for (int a = 0; a < v.na; a++)
        for (int i = out.first[a]; i < end[a]; i++) {
            const int t = a - first[i]; // beyond own[i] if i lies before what the pixel touches
            float* to = out.of(a, v.moments) + int64_t(i - out.first[a]) * run;
            for (int m = 0; m < v.moments && t < own[i]; m++, to += int64_t(out.taps_of(a)) * run)
                *to = voxels[m].weight[size_t(t) * n + i];
        }
}

// A pixel's two edges lie y0 and y1 voxels up; how far apart they are at most is convex along the rows.
int voxels_over(const Edges& e, const Columns& c, int b0, int b1) {
    double most = 0;
    for (int b : {b0, b1 - 1}) {
        double low = 1e300, high = -1e300;
        for (double a : {c.a, c.a + c.behind}) {
            const double per = 1 / (e.slope + a * e.slope_step), y = (b - e.offset - a * e.offset_step) * per;
            low = std::min(low, y);
            high = std::max(high, y + per);
        }
        most = std::max(most, high - low);
    }
    return int(most) + 2;
}

int pixels_under(const Edges& e, int ny, int na) {
    double most = 0;
    for (int y : {0, ny - 1})
        for (int a : {0, (na - 1) / pair * pair}) {
            const int last = a + pair - 1;
            most = std::max(most, std::max(e.at(y + 1, a), e.at(y + 1, last)) - std::min(e.at(y, a), e.at(y, last)));
        }
    return int(most) + 2;
}

// Numerical kernels.
PALPATE_KERNEL void place_run(const Edges& e, double a, double behind, int b0, int count, int low, int high,
                              int32_t* __restrict first, float* __restrict start, float* __restrict step) {
    const double s0 = e.slope + a * e.slope_step, o0 = e.offset + a * e.offset_step;
    const double s1 = s0 + behind * e.slope_step, o1 = o0 + behind * e.offset_step, per0 = 1 / s0, per1 = 1 / s1;
    const double least = low, most = high, slope_step = e.slope_step, offset_step = e.offset_step;
    for (int i = 0; i < count; i++) {
        const double b = b0 + i, y = std::floor(std::min((b - o0) * per0, (b - o1) * per1));
        const double from = std::min(std::max(y, least), most);
        first[i] = int32_t(from);
        start[i] = float(s0 * (from + 1) + o0 - b);
        step[i] = float(slope_step * (from + 1) + offset_step);
    }
}

void place_voxels(const Edges& edges, const Columns& columns, int b0, int count, int low, int high, int point,
                  Places& out) {
    place_run(edges, columns.a, columns.behind, b0, count, low, high, out.first[point], out.start[point],
              out.step[point]);
}

PALPATE_INLINE void at_least(Lanes& v, const Lanes& least) { v = v > least ? v : least; }
PALPATE_INLINE void at_most(Lanes& v, const Lanes& most) { v = v < most ? v : most; }

// The part of a pixel left of each edge between its voxels is c: the voxels' weights are c_1, c_2 - c_1, ..., 1 - c_n,
// and their sum is that of c times the step down from voxel to voxel. fixed: the taps, or 0 for any.
template <int points, int fixed>
PALPATE_INLINE void add_voxels_by(const float* rows, int64_t point_size, const Places& places, const Lanes* slope,
                                  const Lanes& columns, int any, int begin, int count, float* sum) {
    const int taps = fixed ? fixed : any;
    const Lanes zero = {}, one = zero + 1.0f, ramp = columns;
    for (int r = 0; r < count; r++) {
        Lanes total;
        load(total, sum + r * width);
#pragma GCC unroll 4
        for (int m = 0; m < points; m++) {
            const float* x = rows + m * point_size + (places.first[m][r] - begin) * width;
            Lanes edge = places.start[m][r] + ramp * places.step[m][r], here, next;
            load(here, x);
#pragma GCC unroll 4
            for (int t = 1; t < taps; t++) {
                Lanes part = edge;
                at_least(part, zero);
                at_most(part, one);
                load(next, x + t * width);
                total += part * (here - next);
                here = next;
                edge += slope[m];
            }
            total += here;
        }
        store(sum + r * width, total);
    }
}

template <int points>
PALPATE_INLINE void add_voxels_of(const float* rows, int64_t point_size, const Places& places, const Lanes* slope,
                                  const Lanes& ramp, int taps, int begin, int count, float* sum) {
    if (taps == 2) return add_voxels_by<points, 2>(rows, point_size, places, slope, ramp, taps, begin, count, sum);
    if (taps == 3) return add_voxels_by<points, 3>(rows, point_size, places, slope, ramp, taps, begin, count, sum);
    add_voxels_by<points, 0>(rows, point_size, places, slope, ramp, taps, begin, count, sum);
}

PALPATE_KERNEL void add_voxels(const float* rows, int64_t point_size, const Places& places, const Edges* edges,
                               const Columns& columns, int points, int taps, int begin, int count, float* sum) {
    Lanes slope[most_moments];
    for (int m = 0; m < points; m++)
        slope[m] = float(edges[m].slope + columns.a * edges[m].slope_step) + columns.ramp * float(edges[m].slope_step);
    if (points == 1) return add_voxels_of<1>(rows, point_size, places, slope, columns.ramp, taps, begin, count, sum);
    if (points == 2) return add_voxels_of<2>(rows, point_size, places, slope, columns.ramp, taps, begin, count, sum);
    add_voxels_of<3>(rows, point_size, places, slope, columns.ramp, taps, begin, count, sum);
}

// The part of each pixel between a voxel's edges, for two vectors of columns that begin in the same row of the image.
template <int fixed>
PALPATE_INLINE void add_pixels_by(const Edges& e, int y, int any, int nb, const float* image, int64_t stride, int begin,
                                  int end, float* out) {
    const int taps = fixed ? fixed : any;
    const double slope0 = e.slope_step * y + e.offset_step, slope1 = slope0 + e.slope_step;
    const double start0 = e.at(y, 0), start1 = e.at(y + 1, 0), fall = std::min(slope0 * (pair - 1), 0.0);
    const double least = -taps, most = nb;
    const Lanes zero = {}, ramp = {0, 1, 2, 3, 4, 5, 6, 7};
    const Lanes step0 = ramp * float(slope0), step1 = ramp * float(slope1);
    const float behind0 = float(lanes * slope0), behind1 = float(lanes * slope1);
    for (int a = begin; a < end; a += pair) {
        const double low = start0 + slope0 * a, high = start1 + slope1 * a;
        const double from = std::min(std::max(std::floor(low + fall), least), most);
        const Lanes left0 = float(low - from) + step0, right0 = float(high - from) + step1;
        const Lanes left1 = left0 + behind0, right1 = right0 + behind1;
        Lanes sum0 = {}, sum1 = {};
        const float* x = image + int64_t(from) * stride + a;
#pragma GCC unroll 4
        for (int t = 0; t < taps; t++, x += stride) {
            const Lanes begins = zero + float(t), ends = zero + float(t + 1);
            Lanes part0 = right0, part1 = right1, before0 = left0, before1 = left1, v0, v1;
            at_most(part0, ends), at_most(part1, ends);
            at_least(before0, begins), at_least(before1, begins);
            part0 -= before0, part1 -= before1;
            at_least(part0, zero), at_least(part1, zero);
            load(v0, x), load(v1, x + lanes);
            sum0 += part0 * v0, sum1 += part1 * v1;
        }
        store(out + a - begin, sum0);
        store(out + a - begin + lanes, sum1);
    }
}

PALPATE_KERNEL void add_pixels(const Edges& edges, int y, int taps, int nb, const float* image, int64_t stride,
                               int begin, int end, float* out) {
    if (taps == 3) return add_pixels_by<3>(edges, y, taps, nb, image, stride, begin, end, out);
    if (taps == 4) return add_pixels_by<4>(edges, y, taps, nb, image, stride, begin, end, out);
    add_pixels_by<0>(edges, y, taps, nb, image, stride, begin, end, out);
}

template <int vectors, int rows>
PALPATE_INLINE void resample_eight(const float* source, int64_t stride, int64_t point_size, const Reach& reach,
                                   int points, const float* weight, int taps, float* out) {
    Lanes sum[rows] = {};
    const Order order = reach.order;
    for (int m = 0; m < points; m++) {
        const float* from = source + m * point_size + reach.first;
        for (int t = 0; t < taps; t++, from++, weight += run) {
            Lanes w, x, y;
            load(w, weight);
#pragma GCC unroll 4
            for (int r = 0; r < rows; r++) {
                load(x, from + r * stride);
                if (vectors == 2) {
                    load(y, from + r * stride + lanes);
                    x = __builtin_shuffle(x, y, order);
                } else {
                    x = __builtin_shuffle(x, order);
                }
                sum[r] += x * w;
            }
        }
    }
#pragma GCC unroll 4
    for (int r = 0; r < rows; r++) store(out + r * run, sum[r]);
}

template <int vectors>
PALPATE_INLINE void resample_points_by(const float* source, int64_t stride, int64_t point_size, int rows,
                                       const Reach& reach, int points, const float* weight, int taps, float* out) {
    int r = 0;
    for (; r + 4 <= rows; r += 4)
        resample_eight<vectors, 4>(source + r * stride, stride, point_size, reach, points, weight, taps, out + r * run);
    for (; r < rows; r++)
        resample_eight<vectors, 1>(source + r * stride, stride, point_size, reach, points, weight, taps, out + r * run);
}

PALPATE_KERNEL void resample_points(const float* source, int64_t stride, int64_t point_size, int rows,
                                    const int32_t* first, int columns, int points, const float* weight, int taps,
                                    float* out) {
    const Reach reach(first, taps, columns);
    if (reach.vectors == Reach::one)
        return resample_points_by<1>(source, stride, point_size, rows, reach, points, weight, taps, out);
    if (reach.vectors == Reach::two)
        return resample_points_by<2>(source, stride, point_size, rows, reach, points, weight, taps, out);
    for (int r = 0; r < rows; r++, source += stride, out += run) {
        float sum[lanes] = {};
        for (int m = 0; m < points; m++)
            for (int t = 0; t < taps; t++)
                for (int i = 0; i < lanes; i++)
                    sum[i] += weight[(m * taps + t) * run + i] * source[m * point_size + first[i] + t];
        for (int i = 0; i < lanes; i++) out[i] = sum[i];
    }
}

} // namespace palpate
