#pragma once
#include "dispatch.h"
#include <cstdint>
#include <cstring>

namespace palpate {

// Eight floats in one register (or two). Wider vector types would pass through memory where registers are narrower.
typedef float Lanes __attribute__((vector_size(32)));
typedef int32_t LaneMask __attribute__((vector_size(32)));
constexpr int lanes = 8;
#if defined(__clang__)
#define PALPATE_UNROLL _Pragma("clang loop unroll(full)")
#else
#define PALPATE_UNROLL _Pragma("GCC unroll 8")
#endif
PALPATE_INLINE void load(Lanes& v, const float* p) { std::memcpy(&v, p, sizeof v); }
PALPATE_INLINE void store(float* p, const Lanes& v) { std::memcpy(p, &v, sizeof v); }
PALPATE_INLINE float total(const Lanes& v) { return ((v[0] + v[4]) + (v[1] + v[5])) + ((v[2] + v[6]) + (v[3] + v[7])); }

// Eight vectors, `stride` floats apart. Written out: a loop that stays one keeps the vectors in memory.
PALPATE_INLINE void load_each(Lanes (&r)[lanes], const float* p, int64_t stride) {
    load(r[0], p), load(r[1], p + stride), load(r[2], p + 2 * stride), load(r[3], p + 3 * stride);
    p += 4 * stride;
    load(r[4], p), load(r[5], p + stride), load(r[6], p + 2 * stride), load(r[7], p + 3 * stride);
}
PALPATE_INLINE void store_each(float* p, int64_t stride, const Lanes (&r)[lanes]) {
    store(p, r[0]), store(p + stride, r[1]), store(p + 2 * stride, r[2]), store(p + 3 * stride, r[3]);
    p += 4 * stride;
    store(p, r[4]), store(p + stride, r[5]), store(p + 2 * stride, r[6]), store(p + 3 * stride, r[7]);
}

// m[i][j] becomes m[j][i].
PALPATE_INLINE void transpose(Lanes (&m)[lanes]) {
    Lanes p[lanes], q[lanes];
    PALPATE_UNROLL
    for (int i = 0; i < 4; i++) {
        p[2 * i] = __builtin_shufflevector(m[2 * i], m[2 * i + 1], 0, 8, 1, 9, 4, 12, 5, 13);
        p[2 * i + 1] = __builtin_shufflevector(m[2 * i], m[2 * i + 1], 2, 10, 3, 11, 6, 14, 7, 15);
    }
    PALPATE_UNROLL
    for (int i = 0; i < 4; i++) {
        const Lanes &u = p[i + (i & 2)], &v = p[i + (i & 2) + 2];
        q[2 * i] = __builtin_shufflevector(u, v, 0, 1, 8, 9, 4, 5, 12, 13);
        q[2 * i + 1] = __builtin_shufflevector(u, v, 2, 3, 10, 11, 6, 7, 14, 15);
    }
    PALPATE_UNROLL
    for (int i = 0; i < 4; i++) {
        m[i] = __builtin_shufflevector(q[i], q[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        m[i + 4] = __builtin_shufflevector(q[i], q[i + 4], 4, 5, 6, 7, 12, 13, 14, 15);
    }
}

// v where the mask is set, else w.
PALPATE_INLINE void choose(const LaneMask& mask, const Lanes& v, const Lanes& w, Lanes& out) {
    LaneMask a, b;
    std::memcpy(&a, &v, sizeof a);
    std::memcpy(&b, &w, sizeof b);
    a = (a & mask) | (b & ~mask);
    std::memcpy(&out, &a, sizeof a);
}

PALPATE_INLINE void magnitude(const Lanes& v, Lanes& out) {
    LaneMask bits;
    std::memcpy(&bits, &v, sizeof bits);
    bits &= 0x7fffffff;
    std::memcpy(&out, &bits, sizeof bits);
}

} // namespace palpate
