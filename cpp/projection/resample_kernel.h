// The first pass of the projectors, for eight neighbouring columns: a gather by whole vectors and shuffles.
// Inlined into the passes of parallel and of rotated panels.
#pragma once
#include "base/simd.h"
#include "projection/tile_weights.h"

namespace palpate {

// The first pass of the projectors, for eight neighbouring columns: weights as in TileWeights.

// The offset of tap t from a column's first: the first taps lie side by side, the others from odd_offset on (see
// ColumnWeights).
PALPATE_INLINE int64_t place(int t, int taps_side_by_side, int64_t odd_offset) {
    return t < taps_side_by_side ? t : t - taps_side_by_side + odd_offset;
}

// out[moment][row][0..8] = sum over taps of weight * source[row][first + tap], for `rows` rows. `fixed` is the number
// of taps if it is known at compile time, else 0. Rows of out are `pitch` floats long. Numerical kernel.
template <int moments, int vectors, int rows, int fixed, bool deinterleaved, int pitch>
PALPATE_INLINE void resample_eight(const float* source, int64_t stride, const int32_t* places, const float* weight,
                                   int taps, int64_t odd_offset, int64_t moment_size, float* out) {
    i32x8 order;
    std::memcpy(&order, places, sizeof order);
    f32x8 sum[moments][rows];
    const int count = fixed ? fixed : taps, taps_side_by_side = deinterleaved ? (count + 1) / 2 : count;
    PALPATE_UNROLL_UP_TO(4)
    for (int m = 0; m < moments; m++) PALPATE_UNROLL_UP_TO(4)
    for (int r = 0; r < rows; r++) sum[m][r] = f32x8{};
    PALPATE_UNROLL
    for (int t = 0; t < count; t++) {
        f32x8 w[moments];
        const float* from = source + (deinterleaved ? place(t, taps_side_by_side, odd_offset) : t);
        PALPATE_UNROLL_UP_TO(4)
        for (int m = 0; m < moments; m++) load(w[m], weight + (m * taps + t) * tile_size);
        PALPATE_UNROLL_UP_TO(4)
        for (int r = 0; r < rows; r++) {
            f32x8 x, y;
            load(x, from + r * stride);
            if (vectors == 2) {
                load(y, from + r * stride + lanes);
                permute(x, y, order, x);
            } else {
                permute(x, order, x);
            }
            PALPATE_UNROLL_UP_TO(4)
            for (int m = 0; m < moments; m++) sum[m][r] += x * w[m];
        }
    }
    PALPATE_UNROLL_UP_TO(4)
    for (int m = 0; m < moments; m++) PALPATE_UNROLL_UP_TO(4)
    for (int r = 0; r < rows; r++) store(out + m * moment_size + r * pitch, sum[m][r]);
}

// The same, one element at a time, for any pattern. source: column 0.
template <int pitch>
PALPATE_INLINE void gather_eight(const float* source, int64_t stride, int rows, const int32_t* first, int moments,
                                 const float* weight, int taps, int taps_side_by_side, int64_t odd_offset,
                                 int64_t moment_size, float* out) {
    for (int m = 0; m < moments; m++, weight += taps * tile_size, out += moment_size)
        for (int r = 0; r < rows; r++) {
            float sum[lanes] = {};
            for (int t = 0; t < taps; t++) {
                const float* from = source + r * stride + place(t, taps_side_by_side, odd_offset);
                for (int i = 0; i < lanes; i++) sum[i] += weight[t * tile_size + i] * from[first[i]];
            }
            for (int i = 0; i < lanes; i++) out[r * pitch + i] = sum[i];
        }
}

} // namespace palpate
