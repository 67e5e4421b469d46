// The first pass resamples the rows of the source, `rows_at_once` at a time and all moments at once. Neighbouring
// results have neighbouring sources, so that a tap is one load and one shuffle of a vector instead of a gather. The
// second pass adds whole rows as soon as they are resampled: they stay in the first-level cache, and so does the
// tile.
#include "projection/separable_passes.h"
#include "projection/resample_kernel.h"

namespace palpate {
namespace {

constexpr int prefetch_rows = 2 * rows_at_once; // by about the latency of memory

// Resamples `rows` rows of the source. single_vector: see ColumnWeights.
template <int moments, int rows, int fixed, bool single_vector, bool deinterleaved>
PALPATE_INLINE void resample_rows(const float* source, int64_t stride, const ColumnWeights& columns,
                                  int64_t moment_size, float* out) {
    const TileWeights& c = columns.weights;
    for (int j = 0; j < c.count; j += lanes) {
        const ShufflePattern& reach = columns.reach[j / lanes];
        const float *from = source + reach.first, *weight = c.weight.data() + j;
        if (rows > 1 && j % (2 * lanes) == 0) PALPATE_UNROLL_UP_TO(4)
        for (int r = 0; r < rows; r++) __builtin_prefetch(from + (r + prefetch_rows) * stride, 0, 3);
        if (single_vector || reach.vectors == ShufflePattern::one)
            resample_eight<moments, 1, rows, fixed, deinterleaved, tile_columns>(
                from, stride, reach.order, weight, c.taps, columns.odd_offset, moment_size, out + j);
        else if (reach.vectors == ShufflePattern::two)
            resample_eight<moments, 2, rows, 0, deinterleaved, tile_columns>(from, stride, reach.order, weight, c.taps,
                                                                             columns.odd_offset, moment_size, out + j);
        else
            gather_eight<tile_columns>(source, stride, rows, c.first + j, moments, weight, c.taps,
                                       columns.taps_side_by_side(), columns.odd_offset, moment_size, out + j);
    }
}

// sum[0..tile_columns] += sum over moments and taps of weight * buffer[moment][row + tap]. Numerical kernel.
template <int moments, int taps>
PALPATE_INLINE void add_row(const float* buffer, int row, int mask, int64_t moment_size, const float* weight,
                            int weight_size, float* sum) {
    f32x8 s[tile_columns / lanes];
    load_each(s, sum, lanes);
    PALPATE_UNROLL_UP_TO(4)
    for (int t = 0; t < taps; t++) {
        const float* from = buffer + ((row + t) & mask) * tile_columns;
        PALPATE_UNROLL_UP_TO(4)
        for (int m = 0; m < moments; m++) {
            const float w = weight[m * weight_size + t * tile_size];
            f32x8 x[tile_columns / lanes];
            load_each(x, from + m * moment_size, lanes);
            PALPATE_UNROLL
            for (int i = 0; i < tile_columns / lanes; i++) s[i] += x[i] * w;
        }
    }
    store_each(sum, lanes, s);
}

template <int moments>
PALPATE_INLINE void add_row_of(const float* buffer, int row, int mask, int64_t moment_size, const float* weight,
                               int weight_size, int taps, float* sum) {
    for (; taps > 4; taps -= 4, row += 4, weight += 4 * tile_size)
        add_row<moments, 4>(buffer, row, mask, moment_size, weight, weight_size, sum);
    switch (taps) {
    case 4:
        return add_row<moments, 4>(buffer, row, mask, moment_size, weight, weight_size, sum);
    case 3:
        return add_row<moments, 3>(buffer, row, mask, moment_size, weight, weight_size, sum);
    case 2:
        return add_row<moments, 2>(buffer, row, mask, moment_size, weight, weight_size, sum);
    case 1:
        return add_row<moments, 1>(buffer, row, mask, moment_size, weight, weight_size, sum);
    }
}

// Numerical kernel.
template <int moments, int fixed, bool single_vector, bool deinterleaved>
PALPATE_INLINE void add_subslice_by(const SourceRows& source, const TileWeights& rows, const ColumnWeights& columns,
                                    RowBuffer& buffer, float* sum) {
    const int count = rows.end - rows.begin, mask = buffer.size - 1;
    const int64_t moment_size = int64_t(buffer.size) * tile_columns, stride = source.stride;
    const float* from = source.values + rows.begin * stride;
    float* to = buffer.values.data();
    int done = 0;
    for (int r = 0; r < rows.count; r++, sum += tile_columns) {
        if (rows.support[r] == 0) continue;
        const int first = rows.first[r] - rows.begin, last = first + rows.support[r];
        while (done < last) {
            float* out = to + (done & mask) * tile_columns;
            if (done + rows_at_once <= count) {
                resample_rows<moments, rows_at_once, fixed, single_vector, deinterleaved>(from + done * stride, stride,
                                                                                          columns, moment_size, out);
                done += rows_at_once;
            } else {
                resample_rows<moments, 1, fixed, single_vector, deinterleaved>(from + done * stride, stride, columns,
                                                                               moment_size, out);
                done++;
            }
        }
        add_row_of<moments>(to, first, mask, moment_size, rows.weight.data() + r, rows.taps * tile_size,
                            rows.support[r], sum);
    }
}

template <int moments>
PALPATE_INLINE void add_subslice_of(const SourceRows& source, const TileWeights& rows, const ColumnWeights& columns,
                                    RowBuffer& buffer, float* sum) {
    if (columns.odd_offset) {
        if (!columns.single_vector) return add_subslice_by<moments, 0, false, true>(source, rows, columns, buffer, sum);
        switch (columns.weights.taps) {
        case 4:
            return add_subslice_by<moments, 4, true, true>(source, rows, columns, buffer, sum);
        case 5:
            return add_subslice_by<moments, 5, true, true>(source, rows, columns, buffer, sum);
        case 6:
            return add_subslice_by<moments, 6, true, true>(source, rows, columns, buffer, sum);
        }
        return add_subslice_by<moments, 0, true, true>(source, rows, columns, buffer, sum);
    }
    if (!columns.single_vector) return add_subslice_by<moments, 0, false, false>(source, rows, columns, buffer, sum);
    switch (columns.weights.taps) {
    case 2:
        return add_subslice_by<moments, 2, true, false>(source, rows, columns, buffer, sum);
    case 3:
        return add_subslice_by<moments, 3, true, false>(source, rows, columns, buffer, sum);
    case 4:
        return add_subslice_by<moments, 4, true, false>(source, rows, columns, buffer, sum);
    }
    add_subslice_by<moments, 0, true, false>(source, rows, columns, buffer, sum);
}

} // namespace

PALPATE_KERNEL void add_subslice_1(const SourceRows& source, const TileWeights& rows, const ColumnWeights& columns,
                                   RowBuffer& buffer, float* sum) {
    add_subslice_of<1>(source, rows, columns, buffer, sum);
}
PALPATE_KERNEL void add_subslice_2(const SourceRows& source, const TileWeights& rows, const ColumnWeights& columns,
                                   RowBuffer& buffer, float* sum) {
    add_subslice_of<2>(source, rows, columns, buffer, sum);
}
PALPATE_KERNEL void add_subslice_3(const SourceRows& source, const TileWeights& rows, const ColumnWeights& columns,
                                   RowBuffer& buffer, float* sum) {
    add_subslice_of<3>(source, rows, columns, buffer, sum);
}

void add_subslice(const SourceRows& source, const TileWeights& rows, ColumnWeights& columns, RowBuffer& buffer,
                  float* sum) {
    columns.find_patterns();
    buffer.prepare(rows.taps, rows.moments);
    if (rows.moments == 1) return add_subslice_1(source, rows, columns, buffer, sum);
    if (rows.moments == 2) return add_subslice_2(source, rows, columns, buffer, sum);
    add_subslice_3(source, rows, columns, buffer, sum);
}

void ShufflePattern16::find(const TileWeights& columns, int columns_of_source) {
    for (int n = 0; n * simd_width < columns.count; n++) {
        const int32_t* from = columns.first + n * simd_width;
        int support = 0;
        for (int i = 0; i < simd_width; i++) support |= columns.support[n * simd_width + i];
        nonempty[n] = support != 0;
        for (bool within_one : {true, false}) {
            const int furthest = columns_of_source - (within_one ? simd_width + columns.taps - 1 : 2 * simd_width);
            first[n] = std::min(from[0], furthest);
            one[n] = within_one;
            const int reach = from[simd_width - 1] - first[n] + (within_one ? 0 : columns.taps - 1);
            fits[n] = first[n] >= 0 && reach < (within_one ? 1 : 2) * simd_width;
            if (fits[n]) break;
        }
        for (int i = 0; i < simd_width; i++) order[n * simd_width + i] = from[i] - first[n];
    }
}

void ColumnWeights::prepare(int columns_of_source, bool avx512) {
    odd_offset = 0;
    limit = columns_of_source;
    patterns_known = false;
    use_avx512 = avx512;
    if (use_avx512) patterns16.find(weights, limit);
    for (int n = 0; use_avx512 && n * ShufflePattern16::simd_width < weights.count; n++)
        use_avx512 = patterns16.fits[n] || !patterns16.nonempty[n];
}

void ColumnWeights::find_patterns() {
    if (patterns_known) return;
    patterns_known = single_vector = true;
    for (int j = 0; j < weights.count; j += lanes) {
        reach[j / lanes] = ShufflePattern(weights.first + j, taps_side_by_side(), limit);
        single_vector = single_vector && reach[j / lanes].vectors == ShufflePattern::one;
    }
}

// Tap t reads an even element if first + t is even. The even and the odd taps of an element both begin at first / 2
// among the even or odd elements; if `first` is odd, its first even tap has weight 0.
PALPATE_KERNEL void deinterleave(const int32_t* first, int taps, const float* weight, float* even, float* odd) {
    for (int k = 0; 2 * k <= taps; k++)
        for (int i = 0; i < tile_size; i++) {
            const float before = k > 0 ? weight[(2 * k - 1) * tile_size + i] : 0;
            const float here = 2 * k < taps ? weight[2 * k * tile_size + i] : 0;
            even[k * tile_size + i] = first[i] & 1 ? before : here;
        }
    for (int k = 0; 2 * k < taps; k++)
        for (int i = 0; i < tile_size; i++) {
            const float after = 2 * k + 1 < taps ? weight[(2 * k + 1) * tile_size + i] : 0;
            odd[k * tile_size + i] = first[i] & 1 ? weight[2 * k * tile_size + i] : after;
        }
}

void ColumnWeights::prepare_deinterleaved(int columns_of_half, int64_t jump_to_odd) {
    odd_offset = jump_to_odd;
    limit = columns_of_half;
    patterns_known = use_avx512 = false;
    const int taps = weights.taps, size = (taps + 1) * tile_size;
    if (int(deinterleaved.size()) < weights.moments * size) deinterleaved.resize(weights.moments * size);
    for (int m = 0; m < weights.moments; m++) {
        float* even = &deinterleaved[m * size];
        deinterleave(weights.first, taps, &weights.weight[m * taps * tile_size], even,
                     even + (taps / 2 + 1) * tile_size);
    }
    weights.weight.swap(deinterleaved);
    weights.taps = taps + 1;
    for (int i = 0; i < tile_size; i++) weights.first[i] /= 2;
}

void RowBuffer::prepare(int taps, int moments) {
    int needed = rows_at_once;
    while (needed < taps + rows_at_once) needed *= 2;
    if (needed > size) size = needed;
    if (values.size() < size_t(moments) * size * tile_columns) values.resize(size_t(moments) * size * tile_columns);
}

} // namespace palpate
