#include "band_kernels.h"
#include "dispatch.h"
#include "lanes.h"
#include "terms.h"
#include <algorithm>
#include <cstring>

namespace palpate {
namespace {

typedef int32_t Order __attribute__((vector_size(32)));

// out[i] = window[order[i]]: sixteen floats in two vectors, or, where eight neighbours reach further, one by one.
struct Window {
    Lanes low, high;
    PALPATE_INLINE explicit Window(const float* from) { load(low, from), load(high, from + lanes); }
    PALPATE_INLINE void pick(const Order& order, Lanes& out) const { out = __builtin_shuffle(low, high, order); }
};
struct Anywhere {
    const float* from;
    PALPATE_INLINE explicit Anywhere(const float* from) : from(from) {}
    PALPATE_INLINE void pick(const Order& order, Lanes& out) const {
        int32_t index[lanes];
        float picked[lanes];
        std::memcpy(index, &order, sizeof index);
        for (int i = 0; i < lanes; i++) picked[i] = from[index[i]];
        load(out, picked);
    }
};

// Tap t of all eight: from[t + order[i]], as above; Near: order below eight.
struct Near {
    const float* from;
    PALPATE_INLINE explicit Near(const float* from) : from(from) {}
};
PALPATE_INLINE void pick_tap(const Near& near, const Order& order, int t, Lanes& out) {
    load(out, near.from + t);
    out = __builtin_shuffle(out, order);
}
PALPATE_INLINE void pick_tap(const Window& window, const Order& order, int t, Lanes& out) {
    window.pick(order + t, out);
}
PALPATE_INLINE void pick_tap(const Anywhere& anywhere, const Order& order, int t, Lanes& out) {
    anywhere.pick(order + t, out);
}

PALPATE_INLINE void order_of(const int32_t* first, Order& order) {
    std::memcpy(&order, first, sizeof order);
    order -= first[0];
}

// Numerical kernel. A tap t of a voxel belongs to at most t voxels ahead.
template <int terms, int taps, class Sums>
PALPATE_INLINE void look_by(const float* weight, const int32_t* first, const float* sums, int64_t pitch, int groups,
                            float* out, int64_t plane) {
    for (int g = 0; g < groups; g++, first += lanes, out += lanes) {
        Order order[taps];
        order_of(first, order[0]);
        PALPATE_UNROLL
        for (int t = 1; t < taps; t++) order[t] = order[t - 1] + 1;
        const float* from = sums + first[0];
        Lanes slope, band[taps], u, w;
        load(slope, out);
        PALPATE_UNROLL
        for (int m = 0; m < terms; m++, from += pitch) {
            const Sums columns(from);
            PALPATE_UNROLL
            for (int t = 0; t < taps; t++, weight += lanes) {
                columns.pick(order[t], u);
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
                columns.pick(order[t], u);
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

// The same for any number of everything.
PALPATE_INLINE void look_any(const float* weight, const int32_t* first, int terms, int taps, int bands,
                             const float* sums, int64_t pitch, int groups, float* out, int64_t plane) {
    for (int g = 0; g < groups; g++, first += lanes, out += lanes) {
        Order order;
        order_of(first, order);
        for (int q = 0; q < terms + pairs_of(terms); q++)
            for (int t = 0; t < taps; t++) {
                Lanes u, w, sum;
                Anywhere(sums + first[0] + t + q * pitch).pick(order, u);
                const int begin = q < terms ? 0 : 1, end = q < terms ? 1 : 1 + bands;
                for (int k = begin; k < end; k++, weight += lanes) {
                    load(w, weight);
                    load(sum, out + k * plane);
                    sum += w * u;
                    store(out + k * plane, sum);
                }
            }
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

// terms, taps: 0 for any number.
template <int fixed_terms, int fixed_taps, class Changes>
PALPATE_INLINE void spread_by(const float* weight, const int32_t* first, int any_terms, int any_taps,
                              const float* change, int n, float* out, int64_t pitch) {
    const int terms = fixed_terms ? fixed_terms : any_terms, taps = fixed_taps ? fixed_taps : any_taps;
    for (int a = 0; a < n; a += lanes) {
        Order order;
        order_of(first + a, order);
        const Changes changes(change + first[a]);
        Lanes sum[fixed_terms ? fixed_terms : 1], u, w;
        for (int m = 0; m < terms; m += fixed_terms ? fixed_terms : 1) {
            PALPATE_UNROLL
            for (Lanes& s : sum) s = Lanes{};
            PALPATE_UNROLL
            for (int t = 0; t < taps; t++) {
                pick_tap(changes, order, t, u);
                PALPATE_UNROLL
                for (Lanes& s : sum) {
                    load(w, weight);
                    s += w * u;
                    weight += lanes;
                }
            }
            PALPATE_UNROLL
            for (int s = 0; s < (fixed_terms ? fixed_terms : 1); s++) store(out + (m + s) * pitch + a, sum[s]);
        }
    }
}

template <int terms>
PALPATE_INLINE void spread_with(int vectors, const float* weight, const int32_t* first, int taps, const float* change,
                                int n, float* out, int64_t pitch) {
    if (vectors == 2)
        spread_by<terms, 0, Window>(weight, first, terms, taps, change, n, out, pitch);
    else if (taps == 2)
        spread_by<terms, 2, Near>(weight, first, terms, taps, change, n, out, pitch);
    else if (taps == 3)
        spread_by<terms, 3, Near>(weight, first, terms, taps, change, n, out, pitch);
    else if (taps == 4)
        spread_by<terms, 4, Near>(weight, first, terms, taps, change, n, out, pitch);
    else
        spread_by<terms, 0, Near>(weight, first, terms, taps, change, n, out, pitch);
}

} // namespace

PALPATE_KERNEL void look_at(int kernel, bool close, int terms, int taps, int bands, const float* weight,
                            const int32_t* first, const float* sums, int64_t pitch, int groups, float* out,
                            int64_t plane) {
    if (kernel / 10 == 1)
        close ? look_with<1, Window>(taps, weight, first, sums, pitch, groups, out, plane)
              : look_with<1, Anywhere>(taps, weight, first, sums, pitch, groups, out, plane);
    else if (kernel / 10 == 2)
        close ? look_with<2, Window>(taps, weight, first, sums, pitch, groups, out, plane)
              : look_with<2, Anywhere>(taps, weight, first, sums, pitch, groups, out, plane);
    else
        look_any(weight, first, terms, taps, bands, sums, pitch, groups, out, plane);
}

PALPATE_KERNEL void spread_at(int vectors, const float* weight, const int32_t* first, int terms, int taps,
                              const float* change, int n, float* out, int64_t pitch) {
    if (vectors && terms == 1) return spread_with<1>(vectors, weight, first, taps, change, n, out, pitch);
    if (vectors && terms == 2) return spread_with<2>(vectors, weight, first, taps, change, n, out, pitch);
    spread_by<0, 0, Anywhere>(weight, first, terms, taps, change, n, out, pitch);
}

} // namespace palpate
