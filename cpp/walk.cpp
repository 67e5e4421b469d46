#include "walk.h"
#include "dispatch.h"
#include "terms.h"
#include <algorithm>

namespace palpate {
namespace {

// C is weighed by the voxel itself first: terms · terms products a column, then one a term for each of curvature and
// slope. sums: of the first column under the voxel.
template <int terms> PALPATE_INLINE void measure_by(const Walk& v, const float* sums, Lanes& slope, Lanes& curvature) {
    const float *w = v.weight, *change = v.under;
    Lanes push[terms] = {}, bend[terms] = {}, u;
    for (int t = 0; t < v.taps; t++, w += terms, sums += (terms + pairs_of(terms)) * lanes, change += terms * lanes) {
        Lanes weighed[terms];
        PALPATE_UNROLL
        for (int s = 0; s < terms; s++) {
            load(u, sums + (terms + s) * lanes);
            weighed[s] = w[0] * u;
            if (s > 0) weighed[0] += w[s] * u;
        }
        const float* pair = sums + 2 * terms * lanes;
        PALPATE_UNROLL
        for (int m = 1; m < terms; m++) {
            PALPATE_UNROLL
            for (int s = m; s < terms; s++, pair += lanes) {
                load(u, pair);
                weighed[s] += w[m] * u;
                if (s > m) weighed[m] += w[s] * u;
            }
        }
        PALPATE_UNROLL
        for (int m = 0; m < terms; m++) {
            load(u, sums + m * lanes);
            push[m] += w[m] * u;
            load(u, change + m * lanes);
            push[m] += weighed[m] * u;
            bend[m] += w[m] * weighed[m];
        }
    }
    PALPATE_UNROLL
    for (int m = 1; m < terms; m++) push[0] += push[m], bend[0] += bend[m];
    slope += push[0];
    curvature += bend[0];
}

// For any number of terms.
PALPATE_INLINE void measure_any(const Walk& v, const float* sums, Lanes& slope, Lanes& curvature) {
    const float *w = v.weight, *change = v.under;
    for (int t = 0; t < v.taps; t++, w += v.terms, change += v.terms * lanes) {
        const float* pair = sums + v.terms * lanes;
        for (int m = 0; m < v.terms; m++, sums += lanes) {
            Lanes u, moved, other;
            load(u, sums);
            slope += w[m] * u;
            load(moved, change + m * lanes);
            for (int s = m; s < v.terms; s++, pair += lanes) {
                load(u, pair);
                load(other, change + s * lanes);
                slope += s > m ? u * (w[m] * other + w[s] * moved) : w[m] * u * moved;
                curvature += (s > m ? 2 : 1) * w[m] * w[s] * u;
            }
        }
        sums = pair;
    }
}

} // namespace

void Walk::start(const Bands& chosen, int first, int n) {
    bands = &chosen;
    terms = chosen.products();
    from = first;
    const size_t size = size_t(n) * terms * lanes;
    sums.resize(std::max(sums.size(), size_t(n) * (terms + pairs_of(terms)) * lanes));
    change.resize(std::max(change.size(), size));
    std::fill_n(change.begin(), size, 0.0f);
}

PALPATE_KERNEL void measure(const std::vector<Walk*>& walks, int x, Lanes& slope, Lanes& curvature) {
    Lanes push = {}, bend = {};
    for (Walk* walk : walks) {
        Walk& v = *walk;
        const int64_t column = v.bands->first_touched(x) - v.from;
        v.weight = v.bands->along(x);
        v.under = v.change.data() + column * v.terms * lanes;
        v.taps = v.bands->touched(x);
        const float* sums = v.sums.data() + column * (v.terms + pairs_of(v.terms)) * lanes;
        if (v.terms == 1)
            measure_by<1>(v, sums, push, bend);
        else if (v.terms == 2)
            measure_by<2>(v, sums, push, bend);
        else if (v.terms == 3)
            measure_by<3>(v, sums, push, bend);
        else
            measure_any(v, sums, push, bend);
    }
    slope += push;
    curvature += bend;
}

PALPATE_KERNEL void move(const std::vector<Walk*>& walks, const Lanes& change) {
    for (const Walk* walk : walks) {
        const int weights = walk->taps * walk->terms;
        const float* w = walk->weight;
        float* to = walk->under;
        for (int i = 0; i < weights; i++, to += lanes) {
            Lanes u;
            load(u, to);
            u += w[i] * change;
            store(to, u);
        }
    }
}

} // namespace palpate
