// Numerical kernels of the two passes on rotated panels.
#include "projection/rotated_panel_passes.h"
#include "projection/resample_kernel.h"

namespace palpate {
// The rays to a pixel's two edges meet the slice y0 and y1 voxels up; their largest distance is convex along the
// rows.
int voxels_over(const RowEdges& e, const ColumnOctet& c, int b0, int b1) {
    double most = 0;
    for (int b : {b0, b1 - 1}) {
        double low = 1e300, high = -1e300;
        for (double a : {c.a, c.a + c.last_offset}) {
            const double per = 1 / (e.slope + a * e.slope_step), y = (b - e.offset - a * e.offset_step) * per;
            low = std::min(low, y);
            high = std::max(high, y + per);
        }
        most = std::max(most, high - low);
    }
    return int(most) + 2;
}

int pixels_under(const RowEdges& e, int ny, int na) {
    double most = 0;
    for (int y : {0, ny - 1})
        for (int a : {0, (na - 1) / column_pair * column_pair}) {
            const int last = a + column_pair - 1;
            most = std::max(most, std::max(e.at(y + 1, a), e.at(y + 1, last)) - std::min(e.at(y, a), e.at(y, last)));
        }
    return int(most) + 2;
}

// Numerical kernels.
PALPATE_KERNEL void find_voxels(const RowEdges& e, const ColumnOctet& columns, int b0, int count, int low, int high,
                                int point, VoxelPositions& out) {
    int32_t* __restrict first = out.first[point];
    float* __restrict start = out.start[point], * __restrict step = out.step[point];
    const double a = columns.a, last_offset = columns.last_offset;
    const double s0 = e.slope + a * e.slope_step, o0 = e.offset + a * e.offset_step;
    const double s1 = s0 + last_offset * e.slope_step, o1 = o0 + last_offset * e.offset_step, per0 = 1 / s0,
                 per1 = 1 / s1;
    const double least = low, most = high, slope_step = e.slope_step, offset_step = e.offset_step;
    for (int i = 0; i < count; i++) {
        const double b = b0 + i, y = std::floor(std::min((b - o0) * per0, (b - o1) * per1));
        const double from = std::min(std::max(y, least), most);
        first[i] = int32_t(from);
        start[i] = float(s0 * (from + 1) + o0 - b);
        step[i] = float(slope_step * (from + 1) + offset_step);
    }
}

PALPATE_INLINE void at_least(f32x8& v, const f32x8& least) { v = v > least ? v : least; }
PALPATE_INLINE void at_most(f32x8& v, const f32x8& most) { v = v < most ? v : most; }

// Let c_i be the part of a pixel below the i-th edge between its voxels. The voxels' weights are c_1, c_2 - c_1, ...,
// 1 - c_n, so that their sum is c_i times the differences of neighbouring voxels. fixed: the number of taps, or 0 for
// any.
template <int points, int fixed>
PALPATE_INLINE void add_voxels_by(const float* rows, int64_t point_size, const VoxelPositions& places,
                                  const f32x8* slope, const f32x8& columns, int any, int begin, int count, float* sum) {
    const int taps = fixed ? fixed : any;
    const f32x8 zero = {}, one = zero + 1.0f, ramp = columns;
    for (int r = 0; r < count; r++) {
        f32x8 total;
        load(total, sum + r * rotated_tile_columns);
        PALPATE_UNROLL_UP_TO(4)
        for (int m = 0; m < points; m++) {
            const float* x = rows + m * point_size + (places.first[m][r] - begin) * rotated_tile_columns;
            f32x8 edge = places.start[m][r] + ramp * places.step[m][r], here, next;
            load(here, x);
            PALPATE_UNROLL_UP_TO(4)
            for (int t = 1; t < taps; t++) {
                f32x8 part = edge;
                at_least(part, zero);
                at_most(part, one);
                load(next, x + t * rotated_tile_columns);
                total += part * (here - next);
                here = next;
                edge += slope[m];
            }
            total += here;
        }
        store(sum + r * rotated_tile_columns, total);
    }
}

template <int points>
PALPATE_INLINE void add_voxels_of(const float* rows, int64_t point_size, const VoxelPositions& places,
                                  const f32x8* slope, const f32x8& ramp, int taps, int begin, int count, float* sum) {
    if (taps == 2) return add_voxels_by<points, 2>(rows, point_size, places, slope, ramp, taps, begin, count, sum);
    if (taps == 3) return add_voxels_by<points, 3>(rows, point_size, places, slope, ramp, taps, begin, count, sum);
    add_voxels_by<points, 0>(rows, point_size, places, slope, ramp, taps, begin, count, sum);
}

PALPATE_KERNEL void add_voxels(const float* rows, int64_t point_size, const VoxelPositions& places,
                               const RowEdges* edges, const ColumnOctet& columns, int points, int taps, int begin,
                               int count, float* sum) {
    f32x8 slope[max_moments];
    for (int m = 0; m < points; m++)
        slope[m] = float(edges[m].slope + columns.a * edges[m].slope_step) + columns.ramp * float(edges[m].slope_step);
    if (points == 1) return add_voxels_of<1>(rows, point_size, places, slope, columns.ramp, taps, begin, count, sum);
    if (points == 2) return add_voxels_of<2>(rows, point_size, places, slope, columns.ramp, taps, begin, count, sum);
    add_voxels_of<3>(rows, point_size, places, slope, columns.ramp, taps, begin, count, sum);
}

// The part of each pixel between a voxel's edges, for two vectors of columns with the same first row.
template <int fixed>
PALPATE_INLINE void add_pixels_by(const RowEdges& e, int y, int any, int nb, const float* image, int64_t stride,
                                  int begin, int end, float* out) {
    const int taps = fixed ? fixed : any;
    const double slope0 = e.slope_step * y + e.offset_step, slope1 = slope0 + e.slope_step;
    const double start0 = e.at(y, 0), start1 = e.at(y + 1, 0), fall = std::min(slope0 * (column_pair - 1), 0.0);
    const double least = -taps, most = nb;
    const f32x8 zero = {}, ramp = {0, 1, 2, 3, 4, 5, 6, 7};
    const f32x8 step0 = ramp * float(slope0), step1 = ramp * float(slope1);
    const float behind0 = float(lanes * slope0), behind1 = float(lanes * slope1);
    for (int a = begin; a < end; a += column_pair) {
        const double low = start0 + slope0 * a, high = start1 + slope1 * a;
        const double from = std::min(std::max(std::floor(low + fall), least), most);
        const f32x8 left0 = float(low - from) + step0, right0 = float(high - from) + step1;
        const f32x8 left1 = left0 + behind0, right1 = right0 + behind1;
        f32x8 sum0 = {}, sum1 = {};
        const float* x = image + int64_t(from) * stride + a;
        PALPATE_UNROLL_UP_TO(4)
        for (int t = 0; t < taps; t++, x += stride) {
            const f32x8 begins = zero + float(t), ends = zero + float(t + 1);
            f32x8 part0 = right0, part1 = right1, before0 = left0, before1 = left1, v0, v1;
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

PALPATE_KERNEL void add_pixels(const RowEdges& edges, int y, int taps, int nb, const float* image, int64_t stride,
                               int begin, int end, float* out) {
    if (taps == 3) return add_pixels_by<3>(edges, y, taps, nb, image, stride, begin, end, out);
    if (taps == 4) return add_pixels_by<4>(edges, y, taps, nb, image, stride, begin, end, out);
    add_pixels_by<0>(edges, y, taps, nb, image, stride, begin, end, out);
}

template <int points, int vectors>
PALPATE_INLINE void resample_voxels_by(const float* source, int64_t stride, int rows, const ShufflePattern& reach,
                                       const float* weight, int taps, int64_t point_size, float* out) {
    int r = 0;
    source += reach.first;
    for (; r + rows_at_once <= rows; r += rows_at_once)
        resample_eight<points, vectors, rows_at_once, 0, false, rotated_tile_columns>(
            source + r * stride, stride, reach.order, weight, taps, 0, point_size, out + r * rotated_tile_columns);
    for (; r < rows; r++)
        resample_eight<points, vectors, 1, 0, false, rotated_tile_columns>(
            source + r * stride, stride, reach.order, weight, taps, 0, point_size, out + r * rotated_tile_columns);
}

PALPATE_KERNEL void resample_voxels(const float* source, int64_t stride, int rows, const ShufflePattern& reach,
                                    int points, const float* weight, int taps, int64_t point_size, float* out) {
    const bool one = reach.vectors == ShufflePattern::one;
    if (points == 1 && one)
        resample_voxels_by<1, 1>(source, stride, rows, reach, weight, taps, point_size, out);
    else if (points == 1)
        resample_voxels_by<1, 2>(source, stride, rows, reach, weight, taps, point_size, out);
    else if (points == 2 && one)
        resample_voxels_by<2, 1>(source, stride, rows, reach, weight, taps, point_size, out);
    else if (points == 2)
        resample_voxels_by<2, 2>(source, stride, rows, reach, weight, taps, point_size, out);
    else if (one)
        resample_voxels_by<3, 1>(source, stride, rows, reach, weight, taps, point_size, out);
    else
        resample_voxels_by<3, 2>(source, stride, rows, reach, weight, taps, point_size, out);
}

// The same, one element at a time, for any pattern.
PALPATE_KERNEL void gather_voxels(const float* source, int64_t stride, int rows, const int32_t* first, int points,
                                  const float* weight, int taps, int64_t point_size, float* out) {
    gather_eight<rotated_tile_columns>(source, stride, rows, first, points, weight, taps, taps, 0, point_size, out);
}

// In back projection the sums run over the Gauss points too.
template <int vectors, int rows>
PALPATE_INLINE void add_points(const float* source, int64_t stride, int64_t point_size, const ShufflePattern& reach,
                               int points, const float* weight, int taps, float* out) {
    f32x8 sum[rows] = {};
    ShuffleOrder order;
    std::memcpy(&order, reach.order, sizeof order);
    for (int m = 0; m < points; m++) {
        const float* from = source + m * point_size + reach.first;
        for (int t = 0; t < taps; t++, from++, weight += tile_size) {
            f32x8 w, x, y;
            load(w, weight);
            PALPATE_UNROLL_UP_TO(4)
            for (int r = 0; r < rows; r++) {
                load(x, from + r * stride);
                if (vectors == 2) {
                    load(y, from + r * stride + lanes);
                    permute(x, y, order, x);
                } else {
                    permute(x, order, x);
                }
                sum[r] += x * w;
            }
        }
    }
    PALPATE_UNROLL_UP_TO(4)
    for (int r = 0; r < rows; r++) store(out + r * tile_size, sum[r]);
}

template <int vectors>
PALPATE_INLINE void resample_points_by(const float* source, int64_t stride, int64_t point_size, int rows,
                                       const ShufflePattern& reach, int points, const float* weight, int taps,
                                       float* out) {
    int r = 0;
    for (; r + 4 <= rows; r += 4)
        add_points<vectors, 4>(source + r * stride, stride, point_size, reach, points, weight, taps,
                               out + r * tile_size);
    for (; r < rows; r++)
        add_points<vectors, 1>(source + r * stride, stride, point_size, reach, points, weight, taps,
                               out + r * tile_size);
}

PALPATE_KERNEL void resample_points(const float* source, int64_t stride, int64_t point_size, int rows,
                                    const int32_t* first, int columns, int points, const float* weight, int taps,
                                    float* out) {
    const ShufflePattern reach(first, taps, columns);
    if (reach.vectors == ShufflePattern::one)
        return resample_points_by<1>(source, stride, point_size, rows, reach, points, weight, taps, out);
    if (reach.vectors == ShufflePattern::two)
        return resample_points_by<2>(source, stride, point_size, rows, reach, points, weight, taps, out);
    for (int r = 0; r < rows; r++, source += stride, out += tile_size) {
        float sum[lanes] = {};
        for (int m = 0; m < points; m++)
            for (int t = 0; t < taps; t++)
                for (int i = 0; i < lanes; i++)
                    sum[i] += weight[(m * taps + t) * tile_size + i] * source[m * point_size + first[i] + t];
        for (int i = 0; i < lanes; i++) out[i] = sum[i];
    }
}

} // namespace palpate
