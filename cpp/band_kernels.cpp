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

// fixed: the number of taps, or 0 for any.
template <int terms, int fixed, class Changes>
PALPATE_INLINE void spread_by(const float* weight, const int32_t* first, int any, const float* change, int n,
                              float* out, int64_t pitch) {
    const int taps = fixed ? fixed : any;
    for (int a = 0; a < n; a += lanes) {
        Order order;
        order_of(first + a, order);
        const Changes changes(change + first[a]);
        Lanes sum[terms] = {}, u, w;
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
        for (int m = 0; m < terms; m++) store(out + m * pitch + a, sum[m]);
    }
}

template <int terms>
PALPATE_INLINE void spread_with(Span span, const float* weight, const int32_t* first, int taps, const float* change,
                                int n, float* out, int64_t pitch) {
    if (span == Span::any)
        spread_by<terms, 0, Anywhere>(weight, first, taps, change, n, out, pitch);
    else if (span == Span::wide)
        spread_by<terms, 0, Wide>(weight, first, taps, change, n, out, pitch);
    else if (taps == 2)
        spread_by<terms, 2, Near>(weight, first, taps, change, n, out, pitch);
    else if (taps == 3)
        spread_by<terms, 3, Near>(weight, first, taps, change, n, out, pitch);
    else if (taps == 4)
        spread_by<terms, 4, Near>(weight, first, taps, change, n, out, pitch);
    else
        spread_by<terms, 0, Near>(weight, first, taps, change, n, out, pitch);
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

PALPATE_KERNEL void spread_at(Span span, const float* weight, const int32_t* first, int terms, int taps,
                              const float* change, int n, float* out, int64_t pitch) {
    if (terms == 1) return spread_with<1>(span, weight, first, taps, change, n, out, pitch);
    spread_with<2>(span, weight, first, taps, change, n, out, pitch);
}

} // namespace palpate
