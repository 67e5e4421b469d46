#pragma once
#include "dispatch.h"
#include <cstdint>
#include <cstring>

namespace palpate {

// Eight floats in one register (or two): sums stay in fixed lanes, so their order is the same for any instruction set.
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

// v where the mask is set, else w.
PALPATE_INLINE void choose(const LaneMask& mask, const Lanes& v, const Lanes& w, Lanes& out) {
    LaneMask a, b;
    std::memcpy(&a, &v, sizeof a);
    std::memcpy(&b, &w, sizeof b);
    a = (a & mask) | (b & ~mask);
    std::memcpy(&out, &a, sizeof a);
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

// Eight vectors from p, p + step, ..., and back. They must be unrolled, or they go through memory.
PALPATE_INLINE void load_each(Lanes (&m)[lanes], const float* p, int64_t step) {
    PALPATE_UNROLL
    for (int i = 0; i < lanes; i++) load(m[i], p + i * step);
}
PALPATE_INLINE void store_each(float* p, int64_t step, const Lanes (&m)[lanes]) {
    PALPATE_UNROLL
    for (int i = 0; i < lanes; i++) store(p + i * step, m[i]);
}

} // namespace palpate
