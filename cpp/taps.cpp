// The inner loop along x of turned panels.
#include "taps.h"
#include "dispatch.h"

namespace palpate {

PALPATE_KERNEL void add_taps(int n, int taps, const int32_t* __restrict first, const float* __restrict weight,
                             const float* __restrict x, float* __restrict y) {
    for (int t = 0; t < taps; t++) {
        const float* w = weight + int64_t(t) * n;
        const float* from = x + t;
        for (int i = 0; i < n; i++) y[i] += w[i] * from[first[i]];
    }
}

} // namespace palpate
