// Short vectors of 4 or 8 float32 or float64 (GCC vector extensions) for the kernels of every folder, on any thread.
// Arguments go by reference: a vector by value would change the calling convention with the instruction set.
#pragma once
#include "base/cpu_dispatch.h"
#include <cstdint>
#include <cstring>
#if defined(__clang__) && defined(__AVX2__)
#include <immintrin.h>
#endif

namespace palpate {

// Eight floats in one register (or two). Wider vector types would pass through memory where registers are narrower.
typedef float f32x8 __attribute__((vector_size(32)));
typedef int32_t i32x8 __attribute__((vector_size(32)));
constexpr int lanes = 8;
#if defined(__clang__) // a loop whose length is known only at run time stays one
#define PALPATE_UNROLL_UP_TO(count) _Pragma("clang loop unroll(full)")
#else
#define PALPATE_PRAGMA(text) _Pragma(#text)
#define PALPATE_UNROLL_UP_TO(count) PALPATE_PRAGMA(GCC unroll count)
#endif
#define PALPATE_UNROLL PALPATE_UNROLL_UP_TO(8)
PALPATE_INLINE void load(f32x8& v, const float* p) { std::memcpy(&v, p, sizeof v); }
PALPATE_INLINE void store(float* p, const f32x8& v) { std::memcpy(p, &v, sizeof v); }
PALPATE_INLINE float total(const f32x8& v) { return ((v[0] + v[4]) + (v[1] + v[5])) + ((v[2] + v[6]) + (v[3] + v[7])); }

// Eight vectors, `stride` floats apart. Written out: a loop that stays one keeps the vectors in memory.
PALPATE_INLINE void load_each(f32x8 (&r)[lanes], const float* p, int64_t stride) {
    load(r[0], p), load(r[1], p + stride), load(r[2], p + 2 * stride), load(r[3], p + 3 * stride);
    p += 4 * stride;
    load(r[4], p), load(r[5], p + stride), load(r[6], p + 2 * stride), load(r[7], p + 3 * stride);
}
PALPATE_INLINE void store_each(float* p, int64_t stride, const f32x8 (&r)[lanes]) {
    store(p, r[0]), store(p + stride, r[1]), store(p + 2 * stride, r[2]), store(p + 3 * stride, r[3]);
    p += 4 * stride;
    store(p, r[4]), store(p + stride, r[5]), store(p + 2 * stride, r[6]), store(p + 3 * stride, r[7]);
}

// m[i][j] becomes m[j][i].
PALPATE_INLINE void transpose(f32x8 (&m)[lanes]) {
    f32x8 p[lanes], q[lanes];
    PALPATE_UNROLL
    for (int i = 0; i < 4; i++) {
        p[2 * i] = __builtin_shufflevector(m[2 * i], m[2 * i + 1], 0, 8, 1, 9, 4, 12, 5, 13);
        p[2 * i + 1] = __builtin_shufflevector(m[2 * i], m[2 * i + 1], 2, 10, 3, 11, 6, 14, 7, 15);
    }
    PALPATE_UNROLL
    for (int i = 0; i < 4; i++) {
        const f32x8 &u = p[i + (i & 2)], &v = p[i + (i & 2) + 2];
        q[2 * i] = __builtin_shufflevector(u, v, 0, 1, 8, 9, 4, 5, 12, 13);
        q[2 * i + 1] = __builtin_shufflevector(u, v, 2, 3, 10, 11, 6, 7, 14, 15);
    }
    PALPATE_UNROLL
    for (int i = 0; i < 4; i++) {
        m[i] = __builtin_shufflevector(q[i], q[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        m[i + 4] = __builtin_shufflevector(q[i], q[i + 4], 4, 5, 6, 7, 12, 13, 14, 15);
    }
}

// out[i] = x[order[i]], and of x and then y where two are given: an order that is known only at run time.
#if defined(__clang__) && defined(__AVX2__)
PALPATE_INLINE void permute(const f32x8& x, const i32x8& order, f32x8& out) {
    out = _mm256_permutevar8x32_ps(x, __m256i(order));
}
PALPATE_INLINE void permute(const f32x8& x, const f32x8& y, const i32x8& order, f32x8& out) {
#if defined(__AVX512VL__)
    out = _mm256_permutex2var_ps(x, __m256i(order), y);
#else
    const __m256i places(order);
    out = _mm256_blendv_ps(_mm256_permutevar8x32_ps(x, places), _mm256_permutevar8x32_ps(y, places),
                           __m256(_mm256_slli_epi32(places, 28)));
#endif
}
#elif defined(__clang__) // one by one
PALPATE_INLINE void permute(const f32x8& x, const i32x8& order, f32x8& out) {
    float from[lanes], to[lanes];
    store(from, x);
    for (int i = 0; i < lanes; i++) to[i] = from[order[i] & (lanes - 1)];
    load(out, to);
}
PALPATE_INLINE void permute(const f32x8& x, const f32x8& y, const i32x8& order, f32x8& out) {
    float from[2 * lanes], to[lanes];
    store(from, x), store(from + lanes, y);
    for (int i = 0; i < lanes; i++) to[i] = from[order[i] & (2 * lanes - 1)];
    load(out, to);
}
#else
PALPATE_INLINE void permute(const f32x8& x, const i32x8& order, f32x8& out) { out = __builtin_shuffle(x, order); }
PALPATE_INLINE void permute(const f32x8& x, const f32x8& y, const i32x8& order, f32x8& out) {
    out = __builtin_shuffle(x, y, order);
}
#endif

// v where the mask is set, else w.
PALPATE_INLINE void choose(const i32x8& mask, const f32x8& v, const f32x8& w, f32x8& out) {
    i32x8 a, b;
    std::memcpy(&a, &v, sizeof a);
    std::memcpy(&b, &w, sizeof b);
    a = (a & mask) | (b & ~mask);
    std::memcpy(&out, &a, sizeof a);
}

PALPATE_INLINE void magnitude(const f32x8& v, f32x8& out) {
    i32x8 bits;
    std::memcpy(&bits, &v, sizeof bits);
    bits &= 0x7fffffff;
    std::memcpy(&out, &bits, sizeof bits);
}

// Four doubles in one register (or two).
typedef double f64x4 __attribute__((vector_size(32)));
PALPATE_INLINE void load(f64x4& v, const double* p) { std::memcpy(&v, p, sizeof v); }
PALPATE_INLINE void store(double* p, const f64x4& v) { std::memcpy(p, &v, sizeof v); }
PALPATE_INLINE double total(const f64x4& v) { return (v[0] + v[2]) + (v[1] + v[3]); }

// Eight doubles side by side.
struct f64x8 {
    f64x4 low, high;
};

// Eight numbers side by side, and how many such rows the registers hold at a time beside what comes in.
template <class T> struct Vector;
template <> struct Vector<float> {
    using type = f32x8;
    static constexpr int rows = 8;
};
template <> struct Vector<double> {
    using type = f64x8;
    static constexpr int rows = 4;
};
PALPATE_INLINE void load(f64x8& v, const double* p) { load(v.low, p), load(v.high, p + 4); }
PALPATE_INLINE void store(double* p, const f64x8& v) { store(p, v.low), store(p + 4, v.high); }
PALPATE_INLINE void add(f64x8& v, double f, const f64x8& x) { v.low += f * x.low, v.high += f * x.high; }
PALPATE_INLINE void add(f32x8& v, float f, const f32x8& x) { v += f * x; }
PALPATE_INLINE void take(f64x8& v, double f, const f64x8& x) { v.low -= f * x.low, v.high -= f * x.high; }
PALPATE_INLINE void take(f32x8& v, float f, const f32x8& x) { v -= f * x; }
PALPATE_INLINE void multiply(f64x8& v, const f64x8& x) { v.low *= x.low, v.high *= x.high; }
PALPATE_INLINE void multiply(f32x8& v, const f32x8& x) { v *= x; }
PALPATE_INLINE void plus(f64x8& v, const f64x8& x) { v.low += x.low, v.high += x.high; }
PALPATE_INLINE void plus(f32x8& v, const f32x8& x) { v += x; }
PALPATE_INLINE double sum(const f64x8& v) { return total(v.low + v.high); }
PALPATE_INLINE float sum(const f32x8& v) { return total(v); }

// Four floats in one register: a node's x, y, z and a lane that stays zero.
typedef float f32x4 __attribute__((vector_size(16)));
typedef float f32x4_unaligned
    __attribute__((vector_size(16), aligned(4), may_alias)); // read in place: no copy by memory
PALPATE_INLINE void load(f32x4& v, const float* p) { v = *reinterpret_cast<const f32x4_unaligned*>(p); }
PALPATE_INLINE void store(float* p, const f32x4& v) { *reinterpret_cast<f32x4_unaligned*>(p) = v; }
PALPATE_INLINE void widen(const f32x4& v, f64x4& out) { out = __builtin_convertvector(v, f64x4); }
PALPATE_INLINE void narrow(const f64x4& v, f32x4& out) { out = __builtin_convertvector(v, f32x4); }
PALPATE_INLINE void join(const float* low, const float* high, f32x8& out) {
    f32x4 a, b;
    load(a, low), load(b, high);
    out = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
}
// Each lane in all four.
PALPATE_INLINE void broadcast(const f32x4& v, f32x4& x, f32x4& y, f32x4& z) {
    x = __builtin_shufflevector(v, v, 0, 0, 0, 0);
    y = __builtin_shufflevector(v, v, 1, 1, 1, 1);
    z = __builtin_shufflevector(v, v, 2, 2, 2, 2);
}
PALPATE_INLINE void broadcast(const f32x4& v, f32x8& x, f32x8& y, f32x8& z) {
    x = __builtin_shufflevector(v, v, 0, 0, 0, 0, 0, 0, 0, 0);
    y = __builtin_shufflevector(v, v, 1, 1, 1, 1, 1, 1, 1, 1);
    z = __builtin_shufflevector(v, v, 2, 2, 2, 2, 2, 2, 2, 2);
}

} // namespace palpate
