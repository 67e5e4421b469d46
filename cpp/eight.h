#pragma once
#include "lanes.h"
#include "spans.h"

namespace palpate {

// The first pass of the projectors, for eight neighbouring columns: weights as in Spans.

// Where tap t of a column is, counted from its first: `near` lie side by side, the others from `jump` on; see Columns.
PALPATE_INLINE int64_t place(int t, int near, int64_t jump) { return t < near ? t : t - near + jump; }

// out[moment][row][0..8] = sum over taps of weight * source[row][first + tap], for `rows` rows. `fixed` is the number
// of taps, or 0 where only `taps` knows it; rows of out are `pitch` long. Numerical kernel.
template <int moments, int vectors, int rows, int fixed, bool halved, int pitch>
PALPATE_INLINE void resample_eight(const float* source, int64_t stride, const int32_t* places, const float* weight,
                                   int taps, int64_t jump, int64_t moment_size, float* out) {
    LaneMask order;
    std::memcpy(&order, places, sizeof order);
    Lanes sum[moments][rows];
    const int count = fixed ? fixed : taps, near = halved ? (count + 1) / 2 : count;
#pragma GCC unroll 4
    for (int m = 0; m < moments; m++)
#pragma GCC unroll 4
        for (int r = 0; r < rows; r++) sum[m][r] = Lanes{};
#pragma GCC unroll 8
    for (int t = 0; t < count; t++) {
        Lanes w[moments];
        const float* from = source + (halved ? place(t, near, jump) : t);
#pragma GCC unroll 4
        for (int m = 0; m < moments; m++) load(w[m], weight + (m * taps + t) * run);
#pragma GCC unroll 4
        for (int r = 0; r < rows; r++) {
            Lanes x, y;
            load(x, from + r * stride);
            if (vectors == 2) {
                load(y, from + r * stride + lanes);
                x = __builtin_shuffle(x, y, order);
            } else {
                x = __builtin_shuffle(x, order);
            }
#pragma GCC unroll 4
            for (int m = 0; m < moments; m++) sum[m][r] += x * w[m];
        }
    }
#pragma GCC unroll 4
    for (int m = 0; m < moments; m++)
#pragma GCC unroll 4
        for (int r = 0; r < rows; r++) store(out + m * moment_size + r * pitch, sum[m][r]);
}

// The same, one by one: for any reach. source: column 0.
template <int pitch>
PALPATE_INLINE void gather_eight(const float* source, int64_t stride, int rows, const int32_t* first, int moments,
                                 const float* weight, int taps, int near, int64_t jump, int64_t moment_size,
                                 float* out) {
    for (int m = 0; m < moments; m++, weight += taps * run, out += moment_size)
        for (int r = 0; r < rows; r++) {
            float sum[lanes] = {};
            for (int t = 0; t < taps; t++) {
                const float* from = source + r * stride + place(t, near, jump);
                for (int i = 0; i < lanes; i++) sum[i] += weight[t * run + i] * from[first[i]];
            }
            for (int i = 0; i < lanes; i++) out[r * pitch + i] = sum[i];
        }
}

} // namespace palpate
