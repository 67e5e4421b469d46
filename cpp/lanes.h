#pragma once
#include "dispatch.h"
#include <cstdint>
#include <cstring>

namespace palpate {

// Eight floats in one register (or two). Wider vector types would pass through memory where registers are narrower.
typedef float Lanes __attribute__((vector_size(32)));
constexpr int lanes = 8;
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

// Element j of vector i becomes element i of vector j.
PALPATE_INLINE void transpose(Lanes (&r)[lanes]) {
    typedef int Order __attribute__((vector_size(32)));
    const Order low = {0, 8, 1, 9, 4, 12, 5, 13}, high = {2, 10, 3, 11, 6, 14, 7, 15};
    const Order even = {0, 1, 8, 9, 4, 5, 12, 13}, odd = {2, 3, 10, 11, 6, 7, 14, 15};
    const Order left = {0, 1, 2, 3, 8, 9, 10, 11}, right = {4, 5, 6, 7, 12, 13, 14, 15};
    Lanes a[lanes], b[lanes];
    for (int i = 0; i < lanes; i += 2) {
        a[i] = __builtin_shuffle(r[i], r[i + 1], low);
        a[i + 1] = __builtin_shuffle(r[i], r[i + 1], high);
    }
    for (int i = 0; i < lanes; i += 4)
        for (int k = 0; k < 2; k++) {
            b[i + 2 * k] = __builtin_shuffle(a[i + k], a[i + k + 2], even);
            b[i + 2 * k + 1] = __builtin_shuffle(a[i + k], a[i + k + 2], odd);
        }
    for (int i = 0; i < 4; i++) {
        r[i] = __builtin_shuffle(b[i], b[i + 4], left);
        r[i + 4] = __builtin_shuffle(b[i], b[i + 4], right);
    }
}

} // namespace palpate
