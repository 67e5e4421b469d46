// The two passes of the separable projector. The first resamples the rows of the source, `group` at a time and all
// moments at once; neighbouring results have neighbouring sources, so that a tap is one load and one shuffle of a
// vector, not a gather. The second adds whole rows, each as soon as the rows it needs are there: they stay in the
// first-level cache, and so does the tile.
#include "passes.h"
#include "eight.h"
#include "sliding.h"

namespace palpate {
namespace {

constexpr int soon = 2 * group; // rows to call for in advance: as long as memory takes

// `rows` rows of the source, resampled. plain: see ColumnSpans.
template <int moments, int rows, int fixed, bool plain, bool halved>
PALPATE_INLINE void resample_rows(const float* source, int64_t stride, const ColumnSpans& columns, int64_t moment_size,
                                  float* out) {
    const Spans& c = columns.spans;
    for (int j = 0; j < c.count; j += lanes) {
        const Reach& reach = columns.reach[j / lanes];
        const float *from = source + reach.first, *weight = c.weight.data() + j;
        if (rows > 1 && j % (2 * lanes) == 0)
#pragma GCC unroll 4
            for (int r = 0; r < rows; r++) __builtin_prefetch(from + (r + soon) * stride, 0, 3);
        if (plain || reach.vectors == Reach::one)
            resample_eight<moments, 1, rows, fixed, halved, width>(from, stride, reach.order, weight, c.taps,
                                                                   columns.jump, moment_size, out + j);
        else if (reach.vectors == Reach::two)
            resample_eight<moments, 2, rows, 0, halved, width>(from, stride, reach.order, weight, c.taps, columns.jump,
                                                               moment_size, out + j);
        else
            gather_eight<width>(source, stride, rows, c.first + j, moments, weight, c.taps, columns.near(),
                                columns.jump, moment_size, out + j);
    }
}

// sum[0..width] += sum over moments and taps of weight * ring[moment][row + tap]. Numerical kernel.
template <int moments, int taps>
PALPATE_INLINE void add_row(const float* ring, int row, int mask, int64_t moment_size, const float* weight,
                            int weight_size, float* sum) {
    Lanes s[width / lanes];
    load_each(s, sum, lanes);
#pragma GCC unroll 4
    for (int t = 0; t < taps; t++) {
        const float* from = ring + ((row + t) & mask) * width;
#pragma GCC unroll 4
        for (int m = 0; m < moments; m++) {
            const float w = weight[m * weight_size + t * run];
            Lanes x[width / lanes];
            load_each(x, from + m * moment_size, lanes);
            PALPATE_UNROLL
            for (int i = 0; i < width / lanes; i++) s[i] += x[i] * w;
        }
    }
    store_each(sum, lanes, s);
}

template <int moments>
PALPATE_INLINE void add_row_of(const float* ring, int row, int mask, int64_t moment_size, const float* weight,
                               int weight_size, int taps, float* sum) {
    for (; taps > 4; taps -= 4, row += 4, weight += 4 * run)
        add_row<moments, 4>(ring, row, mask, moment_size, weight, weight_size, sum);
    switch (taps) {
    case 4:
        return add_row<moments, 4>(ring, row, mask, moment_size, weight, weight_size, sum);
    case 3:
        return add_row<moments, 3>(ring, row, mask, moment_size, weight, weight_size, sum);
    case 2:
        return add_row<moments, 2>(ring, row, mask, moment_size, weight, weight_size, sum);
    case 1:
        return add_row<moments, 1>(ring, row, mask, moment_size, weight, weight_size, sum);
    }
}

// Numerical kernel.
template <int moments, int fixed, bool plain, bool halved>
PALPATE_INLINE void add_slice_by(const Source& source, const Spans& rows, const ColumnSpans& columns, RowRing& ring,
                                 float* sum) {
    const int count = rows.end - rows.begin, mask = ring.size - 1;
    const int64_t moment_size = int64_t(ring.size) * width, stride = source.stride;
    const float* from = source.values + rows.begin * stride;
    float* to = ring.values.data();
    int done = 0;
    for (int r = 0; r < rows.count; r++, sum += width) {
        if (rows.own[r] == 0) continue;
        const int first = rows.first[r] - rows.begin, last = first + rows.own[r];
        while (done < last) {
            float* out = to + (done & mask) * width;
            if (done + group <= count) {
                resample_rows<moments, group, fixed, plain, halved>(from + done * stride, stride, columns, moment_size,
                                                                    out);
                done += group;
            } else {
                resample_rows<moments, 1, fixed, plain, halved>(from + done * stride, stride, columns, moment_size,
                                                                out);
                done++;
            }
        }
        add_row_of<moments>(to, first, mask, moment_size, rows.weight.data() + r, rows.taps * run, rows.own[r], sum);
    }
}

template <int moments>
PALPATE_INLINE void add_slice_of(const Source& source, const Spans& rows, const ColumnSpans& columns, RowRing& ring,
                                 float* sum) {
    if (columns.jump) {
        if (!columns.plain) return add_slice_by<moments, 0, false, true>(source, rows, columns, ring, sum);
        switch (columns.spans.taps) {
        case 4:
            return add_slice_by<moments, 4, true, true>(source, rows, columns, ring, sum);
        case 5:
            return add_slice_by<moments, 5, true, true>(source, rows, columns, ring, sum);
        case 6:
            return add_slice_by<moments, 6, true, true>(source, rows, columns, ring, sum);
        }
        return add_slice_by<moments, 0, true, true>(source, rows, columns, ring, sum);
    }
    if (!columns.plain) return add_slice_by<moments, 0, false, false>(source, rows, columns, ring, sum);
    switch (columns.spans.taps) {
    case 2:
        return add_slice_by<moments, 2, true, false>(source, rows, columns, ring, sum);
    case 3:
        return add_slice_by<moments, 3, true, false>(source, rows, columns, ring, sum);
    case 4:
        return add_slice_by<moments, 4, true, false>(source, rows, columns, ring, sum);
    }
    add_slice_by<moments, 0, true, false>(source, rows, columns, ring, sum);
}

} // namespace

PALPATE_KERNEL void add_slice_1(const Source& source, const Spans& rows, const ColumnSpans& columns, RowRing& ring,
                                float* sum) {
    add_slice_of<1>(source, rows, columns, ring, sum);
}
PALPATE_KERNEL void add_slice_2(const Source& source, const Spans& rows, const ColumnSpans& columns, RowRing& ring,
                                float* sum) {
    add_slice_of<2>(source, rows, columns, ring, sum);
}
PALPATE_KERNEL void add_slice_3(const Source& source, const Spans& rows, const ColumnSpans& columns, RowRing& ring,
                                float* sum) {
    add_slice_of<3>(source, rows, columns, ring, sum);
}

void add_slice(const Source& source, const Spans& rows, ColumnSpans& columns, RowRing& ring, int64_t ahead,
               float* sum) {
    if (slide_slice(source, rows, columns, ahead, sum)) return;
    columns.see();
    ring.prepare(rows.taps, rows.moments);
    if (rows.moments == 1) return add_slice_1(source, rows, columns, ring, sum);
    if (rows.moments == 2) return add_slice_2(source, rows, columns, ring, sum);
    add_slice_3(source, rows, columns, ring, sum);
}

void Gathering::find(const Spans& columns, int columns_of_source) {
    for (int n = 0; n * wide < columns.count; n++) {
        const int32_t* from = columns.first + n * wide;
        int own = 0;
        for (int i = 0; i < wide; i++) own |= columns.own[n * wide + i];
        reached[n] = own != 0;
        for (bool within_one : {true, false}) {
            const int furthest = columns_of_source - (within_one ? wide + columns.taps - 1 : 2 * wide);
            first[n] = std::min(from[0], furthest);
            one[n] = within_one;
            const int reach = from[wide - 1] - first[n] + (within_one ? 0 : columns.taps - 1);
            fits[n] = first[n] >= 0 && reach < (within_one ? 1 : 2) * wide;
            if (fits[n]) break;
        }
        for (int i = 0; i < wide; i++) order[n * wide + i] = from[i] - first[n];
    }
}

void ColumnSpans::prepare(int columns_of_source) {
    jump = 0;
    limit = columns_of_source;
    seen = false;
    may_slide = slides();
    if (may_slide) gathering.find(spans, limit);
    for (int n = 0; may_slide && n * Gathering::wide < spans.count; n++)
        may_slide = gathering.fits[n] || !gathering.reached[n];
}

void ColumnSpans::see() {
    if (seen) return;
    seen = plain = true;
    for (int j = 0; j < spans.count; j += lanes) {
        reach[j / lanes] = Reach(spans.first + j, near(), limit);
        plain = plain && reach[j / lanes].vectors == Reach::one;
    }
}

// An element's tap t is of the even half where first + t is even. Its taps there begin with first / 2, and so do those
// of the odd half: a first that is odd leaves a gap in the even one.
PALPATE_KERNEL void halve(const int32_t* first, int taps, const float* weight, float* even, float* odd) {
    for (int k = 0; 2 * k <= taps; k++)
        for (int i = 0; i < run; i++) {
            const float before = k > 0 ? weight[(2 * k - 1) * run + i] : 0;
            const float here = 2 * k < taps ? weight[2 * k * run + i] : 0;
            even[k * run + i] = first[i] & 1 ? before : here;
        }
    for (int k = 0; 2 * k < taps; k++)
        for (int i = 0; i < run; i++) {
            const float after = 2 * k + 1 < taps ? weight[(2 * k + 1) * run + i] : 0;
            odd[k * run + i] = first[i] & 1 ? weight[2 * k * run + i] : after;
        }
}

void ColumnSpans::prepare_halved(int columns_of_half, int64_t jump_to_odd) {
    jump = jump_to_odd;
    limit = columns_of_half;
    seen = may_slide = false;
    const int taps = spans.taps, size = (taps + 1) * run;
    if (int(halves.size()) < spans.moments * size) halves.resize(spans.moments * size);
    for (int m = 0; m < spans.moments; m++) {
        float* even = &halves[m * size];
        halve(spans.first, taps, &spans.weight[m * taps * run], even, even + (taps / 2 + 1) * run);
    }
    spans.weight.swap(halves);
    spans.taps = taps + 1;
    for (int i = 0; i < run; i++) spans.first[i] /= 2;
}

void RowRing::prepare(int taps, int moments) {
    int needed = group;
    while (needed < taps + group) needed *= 2;
    if (needed > size) size = needed;
    if (values.size() < size_t(moments) * size * width) values.resize(size_t(moments) * size * width);
}

} // namespace palpate
