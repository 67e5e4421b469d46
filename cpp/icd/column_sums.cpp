#include "icd/column_sums.h"
#include "base/cpu_dispatch.h"
#include <algorithm>

namespace palpate {
namespace {

// fixed: the number of terms, or 0 for any.
template <int fixed> PALPATE_INLINE void add_view(const ColumnSums& v, int x, f32x8& slope, f32x8& curvature) {
    const int terms = fixed ? fixed : v.along_x->terms, size = terms + pairs_of(terms);
    const int64_t column = v.along_x->first[x] - v.from;
    const float *w = v.along_x->of(x), *S = v.sums.data() + column * size * lanes;
    const float* P = v.change.data() + column * terms * lanes;
    f32x8 first = {}, second = {};
    for (int t = v.along_x->count[x]; t > 0; t--, w += size, S += size * lanes, P += terms * lanes) {
        PALPATE_UNROLL
        for (int m = 0; m < terms; m++) {
            f32x8 u, c, p, g = {}; // g = C w of the term
            PALPATE_UNROLL
            for (int s = 0; s < terms; s++) {
                const int low = m < s ? m : s, high = m < s ? s : m;
                load(c, S + (terms + low * (2 * terms - low - 1) / 2 + high) * lanes);
                g += w[s] * c;
            }
            load(u, S + m * lanes);
            load(p, P + m * lanes);
            first += w[m] * u + g * p;
            second += w[m] * g;
        }
    }
    slope += first;
    curvature += second;
}

template <int fixed> PALPATE_INLINE void change_view(ColumnSums& v, int x, const f32x8& change) {
    const int terms = fixed ? fixed : v.along_x->terms, size = terms + pairs_of(terms);
    const float* w = v.along_x->of(x);
    float* P = v.change.data() + int64_t(v.along_x->first[x] - v.from) * terms * lanes;
    for (int t = v.along_x->count[x]; t > 0; t--, w += size)
        for (int m = 0; m < terms; m++, P += lanes) {
            f32x8 u;
            load(u, P);
            u += w[m] * change;
            store(P, u);
        }
}

} // namespace

PALPATE_KERNEL static void find_columns(const int32_t* first, const int32_t* count, int voxels, int32_t& low,
                                        int32_t& high) {
    int32_t least = INT32_MAX, most = 0;
    for (int x = 0; x < voxels; x++) {
        least = std::min(least, count[x] ? first[x] : INT32_MAX);
        most = std::max(most, first[x] + count[x]);
    }
    low = least;
    high = most;
}

void ColumnSums::start(const AxisFootprint& chosen, int begin, int end) {
    along_x = &chosen;
    int32_t low, high;
    find_columns(&chosen.first[begin], &chosen.count[begin], end - begin, low, high);
    from = high ? low / lanes * lanes : 0;
    n = (high - from + lanes - 1) / lanes * lanes;
    sums.resize(std::max(sums.size(), size_t(n) * chosen.stride() * lanes));
    change.resize(std::max(change.size(), size_t(n) * chosen.terms * lanes));
    std::fill_n(change.begin(), size_t(n) * chosen.terms * lanes, 0.0f);
}

PALPATE_KERNEL void add_derivatives(const std::vector<ColumnSums>& views, int x, f32x8& slope, f32x8& curvature) {
    f32x8 first = {}, second = {};
    for (const ColumnSums& v : views) {
        if (v.n == 0) continue;
        if (v.along_x->terms == 1)
            add_view<1>(v, x, first, second);
        else if (v.along_x->terms == 2)
            add_view<2>(v, x, first, second);
        else
            add_view<0>(v, x, first, second);
    }
    slope += first;
    curvature += second;
}

PALPATE_KERNEL void apply_change(std::vector<ColumnSums>& views, int x, const f32x8& change) {
    for (ColumnSums& v : views) {
        if (v.n == 0) continue;
        if (v.along_x->terms == 1)
            change_view<1>(v, x, change);
        else if (v.along_x->terms == 2)
            change_view<2>(v, x, change);
        else
            change_view<0>(v, x, change);
    }
}

} // namespace palpate
