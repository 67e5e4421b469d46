#include "multigrid_sweeps.h"
#include "four.h"

namespace palpate {
namespace {

constexpr int ahead = 768; // floats

void invert(const double* a, double* out) {
    double c[9] = {a[4] * a[8] - a[5] * a[7], a[2] * a[7] - a[1] * a[8], a[1] * a[5] - a[2] * a[4],
                   a[5] * a[6] - a[3] * a[8], a[0] * a[8] - a[2] * a[6], a[2] * a[3] - a[0] * a[5],
                   a[3] * a[7] - a[4] * a[6], a[1] * a[6] - a[0] * a[7], a[0] * a[4] - a[1] * a[3]};
    double determinant = a[0] * c[0] + a[1] * c[3] + a[2] * c[6];
    for (int k = 0; k < 9; k++) out[k] = c[k] / determinant;
}

// The three rows' sums over their lanes, in the first three lanes.
PALPATE_INLINE void across(const Lanes& a, const Lanes& b, const Lanes& c, Four& out) {
    Four a1 = __builtin_shufflevector(a, a, 0, 1, 2, 3) + __builtin_shufflevector(a, a, 4, 5, 6, 7);
    Four b1 = __builtin_shufflevector(b, b, 0, 1, 2, 3) + __builtin_shufflevector(b, b, 4, 5, 6, 7);
    Four c1 = __builtin_shufflevector(c, c, 0, 1, 2, 3) + __builtin_shufflevector(c, c, 4, 5, 6, 7);
    Four ab = __builtin_shufflevector(a1, b1, 0, 4, 1, 5) + __builtin_shufflevector(a1, b1, 2, 6, 3, 7);
    Four cc = c1 + __builtin_shufflevector(c1, c1, 2, 3, 0, 1);
    const Four none = {};
    Four ends = __builtin_shufflevector(cc, none, 0, 4, 1, 4);
    out = __builtin_shufflevector(ab, ends, 0, 1, 4, 5) + __builtin_shufflevector(ab, ends, 2, 3, 6, 5);
}

// g = the row's blocks times v.
// `ahead`: floats to fetch before they are due, in the direction of the sweep.
PALPATE_INLINE void gather(const float* block, const int* column, int first, int last, const float* v, int ahead,
                           Four& g) {
    Lanes a = {}, b = {}, c = {}, x, m;
#pragma GCC unroll 2
    for (int p = first; p < last; p++) {
        const float* rows = block + 24 * size_t(p);
        __builtin_prefetch(rows + ahead);
        join(v + column[2 * p], v + column[2 * p + 1], x);
        load(m, rows), a += m * x;
        load(m, rows + 8), b += m * x;
        load(m, rows + 16), c += m * x;
    }
    across(a, b, c, g);
}

// out gains (sign) the transpose of the row's blocks times v.
PALPATE_INLINE void spread_row(const float* block, const int* column, int first, int last, const Four& v, float* out) {
    Lanes m, v0, v1, v2;
    broadcast(v, v0, v1, v2);
#pragma GCC unroll 2
    for (int p = first; p < last; p++) {
        const float* rows = block + 24 * size_t(p);
        Lanes y;
        load(m, rows), y = m * v0;
        load(m, rows + 8), y += m * v1;
        load(m, rows + 16), y += m * v2;
        Four to;
        float* low = out + column[2 * p];
        load(to, low), store(low, to + __builtin_shufflevector(y, y, 0, 1, 2, 3));
        float* high = out + column[2 * p + 1];
        load(to, high), store(high, to + __builtin_shufflevector(y, y, 4, 5, 6, 7));
    }
}

PALPATE_INLINE void times(const float* columns, const Four& v, Four& out) {
    Four a, b, c, x, y, z;
    load(a, columns), load(b, columns + 4), load(c, columns + 8);
    broadcast(v, x, y, z);
    out = a * x + b * y + c * z;
}

PALPATE_KERNEL void forward(int nodes, const int* start, const int* column, const float* block, const float* inverse,
                            float omega, const float* r, float* d, float* next, float* x, bool first) {
    for (int i = 0; i < nodes; i++) {
        const int from = start[i], to = start[i + 1];
        Four g, t, step;
        gather(block, column, from, to, d, ahead, g);
        load(t, r + 4 * size_t(i));
        t -= g;
        times(inverse + 12 * size_t(i), t, step);
        step *= omega;
        store(d + 4 * size_t(i), step);
        store(next + 4 * size_t(i), (1 - omega) * t);
        spread_row(block, column, from, to, -step, next);
        if (!first) {
            Four old;
            load(old, x + 4 * size_t(i));
            step += old;
        }
        store(x + 4 * size_t(i), step);
    }
}

PALPATE_KERNEL void turn(int nodes, const int* start, const int* column, const float* block, const float* diagonal,
                         const float* inverse, float omega, const float* e, float* r, float* d, float* spread,
                         float* x) {
    for (int i = nodes - 1; i >= 0; i--) {
        const int from = start[i], to = start[i + 1];
        const size_t at = 4 * size_t(i);
        Four g, t, step, given, own, other, now;
        gather(block, column, from, to, e, -ahead, g);
        load(t, r + at), load(given, e + at), load(other, spread + at), load(now, x + at);
        times(diagonal + 3 * at, given, own);
        t -= g + own + other;
        times(inverse + 3 * at, t, step);
        step *= omega;
        given += step;
        store(d + at, step), store(r + at, (1 - omega) * t), store(x + at, now + given);
        spread_row(block, column, from, to, given, spread);
    }
}

PALPATE_KERNEL void backward(int nodes, const int* start, const int* column, const float* block, const float* inverse,
                             float omega, float* r, float* d, float* spread, float* x) {
    for (int i = nodes - 1; i >= 0; i--) {
        const int from = start[i], to = start[i + 1];
        const size_t at = 4 * size_t(i);
        Four g, t, step, other, now;
        gather(block, column, from, to, d, -ahead, g);
        load(t, r + at), load(other, spread + at), load(now, x + at);
        t -= g + other;
        times(inverse + 3 * at, t, step);
        step *= omega;
        store(d + at, step), store(r + at, (1 - omega) * t), store(x + at, now + step);
        spread_row(block, column, from, to, step, spread);
    }
}

PALPATE_KERNEL void last(int nodes, const int* start, const int* column, const float* block, const float* rhs,
                         const float* r, const float* d, float* out) {
    for (int i = 0; i < nodes; i++) {
        const size_t at = 4 * size_t(i);
        Four g, a, b;
        gather(block, column, start[i], start[i + 1], d, ahead, g);
        load(a, rhs + at), load(b, r + at);
        store(out + at, a - b + g);
    }
}

PALPATE_KERNEL void product(int nodes, const int* start, const int* column, const float* block, const float* diagonal,
                            const float* x, float* out) {
    for (int i = 0; i < nodes; i++) {
        const size_t at = 4 * size_t(i);
        Four g, v, own;
        gather(block, column, start[i], start[i + 1], x, ahead, g);
        load(v, x + at);
        times(diagonal + 3 * at, v, own);
        store(out + at, g + own); // rows before spread to rows before them: none has been here
        spread_row(block, column, start[i], start[i + 1], v, out);
    }
}

} // namespace

HalfMatrix::HalfMatrix(const BlockRows& K, const uint8_t* still) : nodes(K.nodes()), start{0} {
    diagonal.assign(12 * size_t(nodes), 0);
    inverse.assign(12 * size_t(nodes), 0);
    for (int i = 0; i < nodes; i++) {
        int lane = 0;
        for (int k = K.start[i]; k < K.start[i + 1] && !(still && still[i]); k++) {
            const int j = K.column[k];
            const double* from = &K.block[9 * size_t(k)];
            if (j == i) {
                double back[9];
                invert(from, back);
                for (int a = 0; a < 3; a++)
                    for (int b = 0; b < 3; b++) {
                        diagonal[12 * size_t(i) + 4 * a + b] = float((from[3 * a + b] + from[3 * b + a]) / 2);
                        inverse[12 * size_t(i) + 4 * a + b] = float((back[3 * a + b] + back[3 * b + a]) / 2);
                    }
            }
            if (j >= i || (still && still[j])) continue;
            if (lane == 0) {
                block.resize(block.size() + 24, 0.0f);
                column.push_back(4 * j), column.push_back(4 * j); // the second's blocks stay zero if none follows
            } else {
                column.back() = 4 * j;
            }
            float* rows = &block[block.size() - 24 + 4 * lane];
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) rows[8 * a + b] = float(from[3 * a + b]);
            lane = 1 - lane;
        }
        start.push_back(int(column.size() / 2));
    }
}

void relax_forward(const HalfMatrix& K, float omega, const float* r, float* d, float* next, float* x, bool first) {
    forward(K.nodes, K.start.data(), K.column.data(), K.block.data(), K.inverse.data(), omega, r, d, next, x, first);
}

void relax_turn(const HalfMatrix& K, float omega, const float* e, float* r, float* d, float* spread, float* x) {
    turn(K.nodes, K.start.data(), K.column.data(), K.block.data(), K.diagonal.data(), K.inverse.data(), omega, e, r, d,
         spread, x);
}

void relax_backward(const HalfMatrix& K, float omega, float* r, float* d, float* spread, float* x) {
    backward(K.nodes, K.start.data(), K.column.data(), K.block.data(), K.inverse.data(), omega, r, d, spread, x);
}

void finish(const HalfMatrix& K, const float* rhs, const float* r, const float* d, float* out) {
    last(K.nodes, K.start.data(), K.column.data(), K.block.data(), rhs, r, d, out);
}

void multiply(const HalfMatrix& K, const float* x, float* out) {
    product(K.nodes, K.start.data(), K.column.data(), K.block.data(), K.diagonal.data(), x, out);
}

} // namespace palpate
