#include "base/simd_transpose.h"
#include "base/simd.h"

namespace palpate {

PALPATE_KERNEL void into_lanes(const float* const* rows, int count, int64_t n, float* out, int step) {
    const int64_t apart = int64_t(step) * lanes;
    int64_t x = 0;
    for (; x + lanes <= n; x += lanes) {
        f32x8 m[lanes] = {};
        PALPATE_UNROLL
        for (int i = 0; i < lanes; i++)
            if (i < count) load(m[i], rows[i] + x);
        transpose(m);
        store_each(out + x * apart, apart, m);
    }
    for (; x < n; x++)
        for (int i = 0; i < lanes; i++) out[x * apart + i] = i < count ? rows[i][x] : 0;
}

PALPATE_KERNEL void out_of_lanes(const float* in, int count, int64_t n, float* const* rows, int step) {
    const int64_t apart = int64_t(step) * lanes;
    int64_t x = 0;
    for (; x + lanes <= n; x += lanes) {
        f32x8 m[lanes];
        load_each(m, in + x * apart, apart);
        transpose(m);
        PALPATE_UNROLL
        for (int i = 0; i < lanes; i++)
            if (i < count) store(rows[i] + x, m[i]);
    }
    for (; x < n; x++)
        for (int i = 0; i < count; i++) rows[i][x] = in[x * apart + i];
}

} // namespace palpate
