#include "band_kernels.h"
#include "dispatch.h"
#include "lanes.h"
#include "terms.h"
#include <algorithm>
#include <cstring>

namespace palpate {
namespace {

typedef int32_t Order __attribute__((vector_size(32)));

// Tap t of all eight: from[t + order[i]]. Window: sixteen floats in two vectors, for t + order below sixteen; Near:
// order below eight; Wide: below sixteen.
struct Window {
    Lanes low, high;
    PALPATE_INLINE explicit Window(const float* from) { load(low, from), load(high, from + lanes); }
    PALPATE_INLINE void pick(const Order& order, int t, Lanes& out) const {
        out = __builtin_shuffle(low, high, order + t);
    }
};
struct Near {
    const float* from;
    PALPATE_INLINE explicit Near(const float* from) : from(from) {}
    PALPATE_INLINE void pick(const Order& order, int t, Lanes& out) const {
        load(out, from + t);
        out = __builtin_shuffle(out, order);
    }
};
struct Wide {
    const float* from;
    PALPATE_INLINE explicit Wide(const float* from) : from(from) {}
    PALPATE_INLINE void pick(const Order& order, int t, Lanes& out) const {
        Lanes low, high;
        load(low, from + t), load(high, from + t + lanes);
        out = __builtin_shuffle(low, high, order);
    }
};
struct Anywhere {
    const float* from;
    PALPATE_INLINE explicit Anywhere(const float* from) : from(from) {}
    PALPATE_INLINE void pick(const Order& order, int t, Lanes& out) const {
        int32_t index[lanes];
        float picked[lanes];
        std::memcpy(index, &order, sizeof index);
        for (int i = 0; i < lanes; i++) picked[i] = from[t + index[i]];
        load(out, picked);
    }
};

PALPATE_INLINE void order_of(const int32_t* first, Order& order) {
    std::memcpy(&order, first, sizeof order);
    order -= first[0];
}

// Numerical kernel. A tap t of a voxel belongs to at most t voxels ahead.
template <int terms, int taps, class Sums>
PALPATE_INLINE void look_by(const float* weight, const int32_t* first, const float* sums, int64_t pitch, int groups,
                            float* out, int64_t plane) {
    for (int g = 0; g < groups; g++, first += lanes, out += lanes) {
        Order order;
        order_of(first, order);
        const float* from = sums + first[0];
        Lanes slope, band[taps], u, w;
        load(slope, out);
        PALPATE_UNROLL
        for (int m = 0; m < terms; m++, from += pitch) {
            const Sums columns(from);
            PALPATE_UNROLL
            for (int t = 0; t < taps; t++, weight += lanes) {
                columns.pick(order, t, u);
                load(w, weight);
                slope += w * u;
            }
        }
        store(out, slope);
        PALPATE_UNROLL
        for (int k = 0; k < taps; k++) load(band[k], out + (1 + k) * plane);
        PALPATE_UNROLL
        for (int q = 0; q < pairs_of(terms); q++, from += pitch) {
            const Sums columns(from);
            PALPATE_UNROLL
            for (int t = 0; t < taps; t++) {
                columns.pick(order, t, u);
                PALPATE_UNROLL
                for (int k = 0; k <= t; k++, weight += lanes) {
                    load(w, weight);
                    band[k] += w * u;
                }
            }
        }
        PALPATE_UNROLL
        for (int k = 0; k < taps; k++) store(out + (1 + k) * plane, band[k]);
    }
}

template <int terms, class Sums>
PALPATE_INLINE void look_with(int taps, const float* weight, const int32_t* first, const float* sums, int64_t pitch,
                              int groups, float* out, int64_t plane) {
    switch (taps) {
    case 2:
        return look_by<terms, 2, Sums>(weight, first, sums, pitch, groups, out, plane);
    case 3:
        return look_by<terms, 3, Sums>(weight, first, sums, pitch, groups, out, plane);
    case 4:
        return look_by<terms, 4, Sums>(weight, first, sums, pitch, groups, out, plane);
    case 5:
        return look_by<terms, 5, Sums>(weight, first, sums, pitch, groups, out, plane);
    case 6:
        return look_by<terms, 6, Sums>(weight, first, sums, pitch, groups, out, plane);
    }
}

// out += Σ over `count` vectors of weight · u, of `rows` rows, `stride` floats apart, that read the weights together.
// Returns the weights behind.
template <int rows>
PALPATE_INLINE const float* add_run(const float* weight, const float* u, int64_t stride, int count, float* out,
                                    int64_t out_row) {
    Lanes sum[rows], other[rows], w, v, x;
    PALPATE_UNROLL
    for (int r = 0; r < rows; r++) load(sum[r], out + r * out_row), other[r] = Lanes{};
    for (; count >= 2; count -= 2, weight += 2 * lanes, u += 2 * lanes) {
        load(w, weight), load(v, weight + lanes);
        PALPATE_UNROLL
        for (int r = 0; r < rows; r++) {
            load(x, u + r * stride);
            sum[r] += w * x;
            load(x, u + r * stride + lanes);
            other[r] += v * x;
        }
    }
    if (count) {
        load(w, weight);
        weight += lanes;
        PALPATE_UNROLL
        for (int r = 0; r < rows; r++) {
            load(x, u + r * stride);
            sum[r] += w * x;
        }
    }
    PALPATE_UNROLL
    for (int r = 0; r < rows; r++) store(out + r * out_row, sum[r] + other[r]);
    return weight;
}

// What the columns say of one term or pair, at each tap; `step` vectors apart.
template <class Sums>
PALPATE_INLINE void lay_out(const Order& order, const float* from, int taps, int step, float* to) {
    const Sums columns(from);
    Lanes u;
    for (int t = 0; t < taps; t++, to += step * lanes) {
        columns.pick(order, t, u);
        store(to, u);
    }
}

// to[tap][s] = Σ over terms m of the voxel's weight · what the columns say of the pair m, s.
template <int terms, class Sums>
PALPATE_INLINE void fold(const Order& order, const float* from, int64_t pitch, int taps, const float* weight,
                         float* to) {
    for (int t = 0; t < taps; t++, to += terms * lanes) {
        Lanes w[terms], sum[terms], u;
        PALPATE_UNROLL
        for (int m = 0; m < terms; m++) load(w[m], weight + (m * taps + t) * lanes), sum[m] = Lanes{};
        const float* pair = from;
        PALPATE_UNROLL
        for (int m = 0; m < terms; m++) {
            PALPATE_UNROLL
            for (int s = m; s < terms; s++, pair += pitch) {
                Sums(pair).pick(order, t, u);
                sum[s] += w[m] * u;
                if (s > m) sum[m] += w[s] * u;
            }
        }
        PALPATE_UNROLL
        for (int m = 0; m < terms; m++) store(to + m * lanes, sum[m]);
    }
}

// Numerical kernel. What the columns say is first laid out as the weights are, so that all that a voxel shares with
// another is one run. folded: the number of terms if what pairs say is folded, else 0.
template <int rows, class Sums, int folded>
PALPATE_INLINE void look_run(int any_terms, int taps, const int32_t* lead, int bands, const float* weight,
                             const int32_t* first, int groups, const Looked& all, int begin, float* scratch) {
    const int terms = folded ? folded : any_terms, pairs = pairs_of(terms), each = folded ? folded : pairs;
    const int slopes = terms * taps, size = slopes + each * taps;
    for (int g = 0; g < groups; g++, first += lanes) {
        Order order;
        order_of(first, order);
        for (int r = 0; r < rows; r++) {
            const float* from = all.sums + (begin + r) * all.row + first[0];
            float* to = scratch + int64_t(r) * size * lanes;
            for (int m = 0; m < terms; m++, from += all.pitch, to += taps * lanes)
                lay_out<Sums>(order, from, taps, 1, to);
            if (folded)
                fold<folded ? folded : 1, Sums>(order, from, all.pitch, taps, weight, to);
            else
                for (int q = 0; q < pairs; q++, from += all.pitch)
                    lay_out<Sums>(order, from, taps, pairs, to + q * lanes);
        }
        float* out = all.out + begin * all.out_row + g * lanes;
        weight = add_run<rows>(weight, scratch, size * lanes, slopes, out, all.out_row);
        for (int k = 0; k < bands; k++)
            weight = add_run<rows>(weight, scratch + (slopes + lead[k] * each) * lanes, size * lanes,
                                   (taps - lead[k]) * each, out + (1 + k) * all.plane, all.out_row);
    }
}

template <class Sums, int folded>
PALPATE_INLINE void look_runs(int terms, int taps, const int32_t* lead, int bands, const float* weight,
                              const int32_t* first, int groups, const Looked& all, float* scratch) {
    int i = 0;
    for (; i + rows_at_once <= all.rows; i += rows_at_once)
        look_run<rows_at_once, Sums, folded>(terms, taps, lead, bands, weight, first, groups, all, i, scratch);
    for (; i < all.rows; i++)
        look_run<1, Sums, folded>(terms, taps, lead, bands, weight, first, groups, all, i, scratch);
}

template <class Sums>
PALPATE_INLINE void look_folded(int terms, int taps, bool folded, const int32_t* lead, int bands, const float* weight,
                                const int32_t* first, int groups, const Looked& all, float* scratch) {
    if (!folded)
        look_runs<Sums, 0>(terms, taps, lead, bands, weight, first, groups, all, scratch);
    else if (terms == 3)
        look_runs<Sums, 3>(terms, taps, lead, bands, weight, first, groups, all, scratch);
    else
        look_runs<Sums, 4>(terms, taps, lead, bands, weight, first, groups, all, scratch);
}

// terms: 0 for any number; then term by term. taps: likewise.
template <int fixed_terms, int fixed_taps, class Changes>
PALPATE_INLINE void spread_by(const float* weight, const int32_t* first, int any_terms, int any_taps,
                              const float* change, int n, float* out, int64_t pitch) {
    constexpr int at_once = fixed_terms ? fixed_terms : 1;
    const int terms = fixed_terms ? fixed_terms : any_terms, taps = fixed_taps ? fixed_taps : any_taps;
    for (int a = 0; a < n; a += lanes) {
        Order order;
        order_of(first + a, order);
        const Changes changes(change + first[a]);
        Lanes sum[at_once], u, w;
        for (int m = 0; m < terms; m += at_once) {
            PALPATE_UNROLL
            for (Lanes& s : sum) s = Lanes{};
            PALPATE_UNROLL
            for (int t = 0; t < taps; t++) {
                changes.pick(order, t, u);
                PALPATE_UNROLL
                for (Lanes& s : sum) {
                    load(w, weight);
                    s += w * u;
                    weight += lanes;
                }
            }
            PALPATE_UNROLL
            for (int s = 0; s < at_once; s++) store(out + (m + s) * pitch + a, sum[s]);
        }
    }
}

template <int terms>
PALPATE_INLINE void spread_with(Span span, const float* weight, const int32_t* first, int any, int taps,
                                const float* change, int n, float* out, int64_t pitch) {
    if (span == Span::any)
        spread_by<terms, 0, Anywhere>(weight, first, any, taps, change, n, out, pitch);
    else if (span == Span::wide)
        spread_by<terms, 0, Wide>(weight, first, any, taps, change, n, out, pitch);
    else if (taps == 2)
        spread_by<terms, 2, Near>(weight, first, any, taps, change, n, out, pitch);
    else if (taps == 3)
        spread_by<terms, 3, Near>(weight, first, any, taps, change, n, out, pitch);
    else if (taps == 4)
        spread_by<terms, 4, Near>(weight, first, any, taps, change, n, out, pitch);
    else
        spread_by<terms, 0, Near>(weight, first, any, taps, change, n, out, pitch);
}

} // namespace

PALPATE_KERNEL void look_at(int kernel, bool close, const float* weight, const int32_t* first, int groups,
                            const Looked& rows) {
    const int taps = kernel % 10;
    for (int i = 0; i < rows.rows; i++) {
        const float* sums = rows.sums + i * rows.row;
        float* out = rows.out + i * rows.out_row;
        if (kernel / 10 == 1)
            close ? look_with<1, Window>(taps, weight, first, sums, rows.pitch, groups, out, rows.plane)
                  : look_with<1, Anywhere>(taps, weight, first, sums, rows.pitch, groups, out, rows.plane);
        else
            close ? look_with<2, Window>(taps, weight, first, sums, rows.pitch, groups, out, rows.plane)
                  : look_with<2, Anywhere>(taps, weight, first, sums, rows.pitch, groups, out, rows.plane);
    }
}

PALPATE_KERNEL void look_along(Span span, int terms, int taps, bool folded, const std::vector<int32_t>& lead,
                               const float* weight, const int32_t* first, int groups, const Looked& rows,
                               float* scratch) {
    const int bands = int(lead.size());
    if (span == Span::near)
        look_folded<Near>(terms, taps, folded, lead.data(), bands, weight, first, groups, rows, scratch);
    else if (span == Span::wide)
        look_folded<Wide>(terms, taps, folded, lead.data(), bands, weight, first, groups, rows, scratch);
    else
        look_folded<Anywhere>(terms, taps, folded, lead.data(), bands, weight, first, groups, rows, scratch);
}

PALPATE_KERNEL void spread_at(Span span, const float* weight, const int32_t* first, int terms, int taps,
                              const float* change, int n, float* out, int64_t pitch) {
    if (terms == 1) return spread_with<1>(span, weight, first, terms, taps, change, n, out, pitch);
    if (terms == 2) return spread_with<2>(span, weight, first, terms, taps, change, n, out, pitch);
    if (terms == 3) return spread_with<3>(span, weight, first, terms, taps, change, n, out, pitch);
    spread_with<0>(span, weight, first, terms, taps, change, n, out, pitch);
}

} // namespace palpate
