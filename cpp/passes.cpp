// The two passes of the separable projector.
#include "passes.h"

namespace palpate {
// out[moment][row][0..8] = sum over taps of weight * source[row][first + tap], for `rows` rows. Numerical kernel.
template <int moments, int vectors, int rows>
PALPATE_INLINE void resample_eight(const float* source, int64_t stride, const Reach& reach, const float* weight,
                                   int taps, int64_t moment_size, float* out) {
    Lanes sum[moments][rows];
#pragma GCC unroll 4
    for (int m = 0; m < moments; m++)
#pragma GCC unroll 4
        for (int r = 0; r < rows; r++) sum[m][r] = Lanes{};
    const Order order = reach.order;
    source += reach.first;
    for (int t = 0; t < taps; t++, source++, weight += run) {
        Lanes w[moments];
#pragma GCC unroll 4
        for (int m = 0; m < moments; m++) load(w[m], weight + m * taps * run);
#pragma GCC unroll 4
        for (int r = 0; r < rows; r++) {
            Lanes x, y;
            load(x, source + r * stride);
            if (vectors == 2) {
                load(y, source + r * stride + lanes);
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
        for (int r = 0; r < rows; r++) store(out + m * moment_size + r * width, sum[m][r]);
}

template <int moments, int vectors>
PALPATE_INLINE void resample_rows_by(const float* source, int64_t stride, int rows, const Reach& reach,
                                     const float* weight, int taps, int64_t moment_size, float* out) {
    int r = 0;
    for (; r + 4 <= rows; r += 4)
        resample_eight<moments, vectors, 4>(source + r * stride, stride, reach, weight, taps, moment_size,
                                            out + r * width);
    for (; r < rows; r++)
        resample_eight<moments, vectors, 1>(source + r * stride, stride, reach, weight, taps, moment_size,
                                            out + r * width);
}

PALPATE_KERNEL void resample_rows(const float* source, int64_t stride, int rows, const Reach& reach, int moments,
                                  const float* weight, int taps, int64_t moment_size, float* out) {
    const bool one = reach.vectors == Reach::one;
    if (moments == 1 && one)
        resample_rows_by<1, 1>(source, stride, rows, reach, weight, taps, moment_size, out);
    else if (moments == 1)
        resample_rows_by<1, 2>(source, stride, rows, reach, weight, taps, moment_size, out);
    else if (moments == 2 && one)
        resample_rows_by<2, 1>(source, stride, rows, reach, weight, taps, moment_size, out);
    else if (moments == 2)
        resample_rows_by<2, 2>(source, stride, rows, reach, weight, taps, moment_size, out);
    else if (one)
        resample_rows_by<3, 1>(source, stride, rows, reach, weight, taps, moment_size, out);
    else
        resample_rows_by<3, 2>(source, stride, rows, reach, weight, taps, moment_size, out);
}

// The same, one by one: for any reach.
PALPATE_KERNEL void gather_rows(const float* source, int64_t stride, int rows, const int32_t* first, int moments,
                                const float* weight, int taps, int64_t moment_size, float* out) {
    for (int m = 0; m < moments; m++, weight += taps * run, out += moment_size)
        for (int r = 0; r < rows; r++) {
            float sum[lanes] = {};
            for (int t = 0; t < taps; t++)
                for (int i = 0; i < lanes; i++) sum[i] += weight[t * run + i] * source[r * stride + first[i] + t];
            for (int i = 0; i < lanes; i++) out[r * width + i] = sum[i];
        }
}

// sum[row] += sum over moments and taps of weight * rows[moment][first[row] + tap]. Numerical kernels.
template <int moments, int taps>
PALPATE_INLINE void add_row_by(const float* x, int64_t moment_size, const float* w, int weight_size, float* sum) {
    Lanes s0, s1, s2, s3;
    load(s0, sum), load(s1, sum + lanes), load(s2, sum + 2 * lanes), load(s3, sum + 3 * lanes);
#pragma GCC unroll 4
    for (int m = 0; m < moments; m++)
#pragma GCC unroll 4
        for (int t = 0; t < taps; t++) {
            const float* from = x + m * moment_size + t * width;
            const float v = w[m * weight_size + t * run];
            Lanes x0, x1, x2, x3;
            load(x0, from), load(x1, from + lanes), load(x2, from + 2 * lanes), load(x3, from + 3 * lanes);
            s0 += x0 * v, s1 += x1 * v, s2 += x2 * v, s3 += x3 * v;
        }
    store(sum, s0), store(sum + lanes, s1), store(sum + 2 * lanes, s2), store(sum + 3 * lanes, s3);
}
template <int moments>
PALPATE_INLINE void add_rows_by(const float* rows, int64_t moment_size, const int32_t* first, const int32_t* own,
                                int begin, const float* weight, int taps, int count, float* sum) {
    for (int r = 0; r < count; r++, sum += width) {
        const float* x = rows + (first[r] - begin) * width;
        const float* w = weight + r;
        int left = own[r];
        for (; left > 4; left -= 4, x += 4 * width, w += 4 * run)
            add_row_by<moments, 4>(x, moment_size, w, taps * run, sum);
        switch (left) {
        case 4:
            add_row_by<moments, 4>(x, moment_size, w, taps * run, sum);
            break;
        case 3:
            add_row_by<moments, 3>(x, moment_size, w, taps * run, sum);
            break;
        case 2:
            add_row_by<moments, 2>(x, moment_size, w, taps * run, sum);
            break;
        case 1:
            add_row_by<moments, 1>(x, moment_size, w, taps * run, sum);
            break;
        }
    }
}
PALPATE_KERNEL void add_rows(const float* rows, int64_t moment_size, const int32_t* first, const int32_t* own,
                             int begin, const float* weight, int moments, int taps, int count, float* sum) {
    if (moments == 1) return add_rows_by<1>(rows, moment_size, first, own, begin, weight, taps, count, sum);
    if (moments == 2) return add_rows_by<2>(rows, moment_size, first, own, begin, weight, taps, count, sum);
    add_rows_by<3>(rows, moment_size, first, own, begin, weight, taps, count, sum);
}

} // namespace palpate
