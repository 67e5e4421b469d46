#include "multigrid/smoother.h"
#include "base/simd.h"

namespace palpate {
namespace {

constexpr int prefetch_distance = 768; // floats

// The sums of three rows over their lanes, in the first three lanes.
PALPATE_INLINE void sum_lanes(const f32x8& a, const f32x8& b, const f32x8& c, f32x4& out) {
    f32x4 a1 = __builtin_shufflevector(a, a, 0, 1, 2, 3) + __builtin_shufflevector(a, a, 4, 5, 6, 7);
    f32x4 b1 = __builtin_shufflevector(b, b, 0, 1, 2, 3) + __builtin_shufflevector(b, b, 4, 5, 6, 7);
    f32x4 c1 = __builtin_shufflevector(c, c, 0, 1, 2, 3) + __builtin_shufflevector(c, c, 4, 5, 6, 7);
    f32x4 ab = __builtin_shufflevector(a1, b1, 0, 4, 1, 5) + __builtin_shufflevector(a1, b1, 2, 6, 3, 7);
    f32x4 cc = c1 + __builtin_shufflevector(c1, c1, 2, 3, 0, 1);
    const f32x4 none = {};
    f32x4 ends = __builtin_shufflevector(cc, none, 0, 4, 1, 4);
    out = __builtin_shufflevector(ab, ends, 0, 1, 4, 5) + __builtin_shufflevector(ab, ends, 2, 3, 6, 5);
}

// The matrix as the kernels read it: its pointers are loaded once, since a store might change anything else.
struct HalfPointers {
    const int *start, *column;
    const float *block, *diagonal, *inverse;
    PALPATE_INLINE HalfPointers(const HalfBlockCsr& K)
        : start(K.start.data()), column(K.column.data()), block(K.block.data()), diagonal(K.diagonal.data()),
          inverse(K.inverse.data()) {}
};

// g = row i of the blocks times v. ahead: the distance to prefetch, in the direction of the sweep.
PALPATE_INLINE void gather(const HalfPointers& K, int i, const float* v, int ahead, f32x4& g) {
    f32x8 a = {}, b = {}, c = {}, x, m;
    const int last = K.start[i + 1];
    PALPATE_UNROLL_UP_TO(2)
    for (int p = K.start[i]; p < last; p++) {
        const float* rows = K.block + 24 * size_t(p);
        __builtin_prefetch(rows + ahead);
        join(v + K.column[2 * p], v + K.column[2 * p + 1], x);
        load(m, rows), a += m * x;
        load(m, rows + 8), b += m * x;
        load(m, rows + 16), c += m * x;
    }
    sum_lanes(a, b, c, g);
}

// out += the transpose of row i of the blocks times v.
PALPATE_INLINE void scatter_row(const HalfPointers& K, int i, const f32x4& v, float* out) {
    f32x8 m, v0, v1, v2;
    broadcast(v, v0, v1, v2);
    const int last = K.start[i + 1];
    PALPATE_UNROLL_UP_TO(2)
    for (int p = K.start[i]; p < last; p++) {
        const float* rows = K.block + 24 * size_t(p);
        f32x8 y;
        load(m, rows), y = m * v0;
        load(m, rows + 8), y += m * v1;
        load(m, rows + 16), y += m * v2;
        f32x4 to;
        float* low = out + K.column[2 * p];
        load(to, low), store(low, to + __builtin_shufflevector(y, y, 0, 1, 2, 3));
        float* high = out + K.column[2 * p + 1];
        load(to, high), store(high, to + __builtin_shufflevector(y, y, 4, 5, 6, 7));
    }
}

PALPATE_INLINE void multiply_block(const float* columns, const f32x4& v, f32x4& out) {
    f32x4 a, b, c, x, y, z;
    load(a, columns), load(b, columns + 4), load(c, columns + 8);
    broadcast(v, x, y, z);
    out = a * x + b * y + c * z;
}

} // namespace

PALPATE_KERNEL void sor_forward(const HalfBlockCsr& matrix, float omega, const float* r, float* d, float* next,
                                float* x, bool first) {
    const HalfPointers K(matrix);
    const int nodes = matrix.nodes();
    for (int i = 0; i < nodes; i++) {
        const size_t at = 4 * size_t(i);
        f32x4 g, t, step;
        gather(K, i, d, prefetch_distance, g);
        load(t, r + at);
        t -= g;
        multiply_block(K.inverse + 3 * at, t, step);
        step *= omega;
        store(d + at, step);
        store(next + at, (1 - omega) * t);
        scatter_row(K, i, -step, next);
        if (!first) {
            f32x4 old;
            load(old, x + at);
            step += old;
        }
        store(x + at, step);
    }
}

PALPATE_KERNEL void sor_backward_first(const HalfBlockCsr& matrix, float omega, const float* e, float* r, float* d,
                                       float* scatter, float* x) {
    const HalfPointers K(matrix);
    for (int i = matrix.nodes() - 1; i >= 0; i--) {
        const size_t at = 4 * size_t(i);
        f32x4 g, t, step, given, own, other, now;
        gather(K, i, e, -prefetch_distance, g);
        load(t, r + at), load(given, e + at), load(other, scatter + at), load(now, x + at);
        multiply_block(K.diagonal + 3 * at, given, own);
        t -= g + own + other;
        multiply_block(K.inverse + 3 * at, t, step);
        step *= omega;
        given += step;
        store(d + at, step), store(r + at, (1 - omega) * t), store(x + at, now + given);
        scatter_row(K, i, given, scatter);
    }
}

PALPATE_KERNEL void sor_backward(const HalfBlockCsr& matrix, float omega, float* r, float* d, float* scatter,
                                 float* x) {
    const HalfPointers K(matrix);
    for (int i = matrix.nodes() - 1; i >= 0; i--) {
        const size_t at = 4 * size_t(i);
        f32x4 g, t, step, other, now;
        gather(K, i, d, -prefetch_distance, g);
        load(t, r + at), load(other, scatter + at), load(now, x + at);
        t -= g + other;
        multiply_block(K.inverse + 3 * at, t, step);
        step *= omega;
        store(d + at, step), store(r + at, (1 - omega) * t), store(x + at, now + step);
        scatter_row(K, i, step, scatter);
    }
}

PALPATE_KERNEL void product_from_residual(const HalfBlockCsr& matrix, const float* rhs, const float* r, const float* d,
                                          float* out) {
    const HalfPointers K(matrix);
    const int nodes = matrix.nodes();
    for (int i = 0; i < nodes; i++) {
        const size_t at = 4 * size_t(i);
        f32x4 g, a, b;
        gather(K, i, d, prefetch_distance, g);
        load(a, rhs + at), load(b, r + at);
        store(out + at, a - b + g);
    }
}

PALPATE_KERNEL void multiply(const HalfBlockCsr& matrix, const float* x, float* out) {
    const HalfPointers K(matrix);
    const int nodes = matrix.nodes();
    for (int i = 0; i < nodes; i++) {
        const size_t at = 4 * size_t(i);
        f32x4 g, v, own;
        gather(K, i, x, prefetch_distance, g);
        load(v, x + at);
        multiply_block(K.diagonal + 3 * at, v, own);
        store(out + at, g + own); // rows scatter to earlier rows only, so this one is new
        scatter_row(K, i, v, out);
    }
}

} // namespace palpate
