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

// g = the row's blocks times v. ahead: the distance to prefetch, in the direction of the sweep.
PALPATE_INLINE void gather(const float* block, const int* column, int first, int last, const float* v, int ahead,
                           f32x4& g) {
    f32x8 a = {}, b = {}, c = {}, x, m;
    PALPATE_UNROLL_UP_TO(2)
    for (int p = first; p < last; p++) {
        const float* rows = block + 24 * size_t(p);
        __builtin_prefetch(rows + ahead);
        join(v + column[2 * p], v + column[2 * p + 1], x);
        load(m, rows), a += m * x;
        load(m, rows + 8), b += m * x;
        load(m, rows + 16), c += m * x;
    }
    sum_lanes(a, b, c, g);
}

// out += the transpose of the row's blocks times v.
PALPATE_INLINE void scatter_row(const float* block, const int* column, int first, int last, const f32x4& v,
                                float* out) {
    f32x8 m, v0, v1, v2;
    broadcast(v, v0, v1, v2);
    PALPATE_UNROLL_UP_TO(2)
    for (int p = first; p < last; p++) {
        const float* rows = block + 24 * size_t(p);
        f32x8 y;
        load(m, rows), y = m * v0;
        load(m, rows + 8), y += m * v1;
        load(m, rows + 16), y += m * v2;
        f32x4 to;
        float* low = out + column[2 * p];
        load(to, low), store(low, to + __builtin_shufflevector(y, y, 0, 1, 2, 3));
        float* high = out + column[2 * p + 1];
        load(to, high), store(high, to + __builtin_shufflevector(y, y, 4, 5, 6, 7));
    }
}

PALPATE_INLINE void multiply_block(const float* columns, const f32x4& v, f32x4& out) {
    f32x4 a, b, c, x, y, z;
    load(a, columns), load(b, columns + 4), load(c, columns + 8);
    broadcast(v, x, y, z);
    out = a * x + b * y + c * z;
}

PALPATE_KERNEL void forward(int nodes, const int* start, const int* column, const float* block, const float* inverse,
                            float omega, const float* r, float* d, float* next, float* x, bool first) {
    for (int i = 0; i < nodes; i++) {
        const int from = start[i], to = start[i + 1];
        f32x4 g, t, step;
        gather(block, column, from, to, d, prefetch_distance, g);
        load(t, r + 4 * size_t(i));
        t -= g;
        multiply_block(inverse + 12 * size_t(i), t, step);
        step *= omega;
        store(d + 4 * size_t(i), step);
        store(next + 4 * size_t(i), (1 - omega) * t);
        scatter_row(block, column, from, to, -step, next);
        if (!first) {
            f32x4 old;
            load(old, x + 4 * size_t(i));
            step += old;
        }
        store(x + 4 * size_t(i), step);
    }
}

PALPATE_KERNEL void backward_first(int nodes, const int* start, const int* column, const float* block,
                                   const float* diagonal, const float* inverse, float omega, const float* e, float* r,
                                   float* d, float* scatter, float* x) {
    for (int i = nodes - 1; i >= 0; i--) {
        const int from = start[i], to = start[i + 1];
        const size_t at = 4 * size_t(i);
        f32x4 g, t, step, given, own, other, now;
        gather(block, column, from, to, e, -prefetch_distance, g);
        load(t, r + at), load(given, e + at), load(other, scatter + at), load(now, x + at);
        multiply_block(diagonal + 3 * at, given, own);
        t -= g + own + other;
        multiply_block(inverse + 3 * at, t, step);
        step *= omega;
        given += step;
        store(d + at, step), store(r + at, (1 - omega) * t), store(x + at, now + given);
        scatter_row(block, column, from, to, given, scatter);
    }
}

PALPATE_KERNEL void backward(int nodes, const int* start, const int* column, const float* block, const float* inverse,
                             float omega, float* r, float* d, float* scatter, float* x) {
    for (int i = nodes - 1; i >= 0; i--) {
        const int from = start[i], to = start[i + 1];
        const size_t at = 4 * size_t(i);
        f32x4 g, t, step, other, now;
        gather(block, column, from, to, d, -prefetch_distance, g);
        load(t, r + at), load(other, scatter + at), load(now, x + at);
        t -= g + other;
        multiply_block(inverse + 3 * at, t, step);
        step *= omega;
        store(d + at, step), store(r + at, (1 - omega) * t), store(x + at, now + step);
        scatter_row(block, column, from, to, step, scatter);
    }
}

PALPATE_KERNEL void from_residual(int nodes, const int* start, const int* column, const float* block, const float* rhs,
                                  const float* r, const float* d, float* out) {
    for (int i = 0; i < nodes; i++) {
        const size_t at = 4 * size_t(i);
        f32x4 g, a, b;
        gather(block, column, start[i], start[i + 1], d, prefetch_distance, g);
        load(a, rhs + at), load(b, r + at);
        store(out + at, a - b + g);
    }
}

PALPATE_KERNEL void product(int nodes, const int* start, const int* column, const float* block, const float* diagonal,
                            const float* x, float* out) {
    for (int i = 0; i < nodes; i++) {
        const size_t at = 4 * size_t(i);
        f32x4 g, v, own;
        gather(block, column, start[i], start[i + 1], x, prefetch_distance, g);
        load(v, x + at);
        multiply_block(diagonal + 3 * at, v, own);
        store(out + at, g + own); // rows scatter to earlier rows only, so this one is new
        scatter_row(block, column, start[i], start[i + 1], v, out);
    }
}

} // namespace

void sor_forward(const HalfBlockCsr& K, float omega, const float* r, float* d, float* next, float* x, bool first) {
    forward(K.nodes(), K.start.data(), K.column.data(), K.block.data(), K.inverse.data(), omega, r, d, next, x, first);
}

void sor_backward_first(const HalfBlockCsr& K, float omega, const float* e, float* r, float* d, float* scatter,
                        float* x) {
    backward_first(K.nodes(), K.start.data(), K.column.data(), K.block.data(), K.diagonal.data(), K.inverse.data(),
                   omega, e, r, d, scatter, x);
}

void sor_backward(const HalfBlockCsr& K, float omega, float* r, float* d, float* scatter, float* x) {
    backward(K.nodes(), K.start.data(), K.column.data(), K.block.data(), K.inverse.data(), omega, r, d, scatter, x);
}

void product_from_residual(const HalfBlockCsr& K, const float* rhs, const float* r, const float* d, float* out) {
    from_residual(K.nodes(), K.start.data(), K.column.data(), K.block.data(), rhs, r, d, out);
}

void multiply(const HalfBlockCsr& K, const float* x, float* out) {
    product(K.nodes(), K.start.data(), K.column.data(), K.block.data(), K.diagonal.data(), x, out);
}

} // namespace palpate
