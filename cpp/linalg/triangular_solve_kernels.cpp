#include "linalg/triangular_solve_kernels.h"
#include "base/simd.h"
#include "linalg/supernodes.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr int width = Supernodes::panel, tile = width * width;

// out -= L x for 8 rows of L (8 numbers a column) and groups of eight right-hand sides. Numerical kernel.
template <class T> PALPATE_INLINE void subtract_rows(const T* L, int64_t depth, const T* x, T* out) {
    using V = typename Vector<T>::type;
    constexpr int rows = Vector<T>::rows;
    for (int first = 0; first < width; first += rows) {
        V sum[rows];
        PALPATE_UNROLL
        for (int r = 0; r < rows; r++) load(sum[r], out + width * (first + r));
        for (int64_t k = 0; k < depth; k++) {
            V v;
            load(v, x + width * k);
            PALPATE_UNROLL
            for (int r = 0; r < rows; r++) take(sum[r], L[width * k + first + r], v);
        }
        PALPATE_UNROLL
        for (int r = 0; r < rows; r++) store(out + width * (first + r), sum[r]);
    }
}

// out -= L' y for a tile of L and 8 rows y, out: 8 rows; each of eight right-hand sides.
template <class T> PALPATE_INLINE void subtract_columns(const T* L, const T* y, T* out) {
    using V = typename Vector<T>::type;
    constexpr int rows = Vector<T>::rows;
    for (int first = 0; first < width; first += rows) {
        V sum[rows];
        PALPATE_UNROLL
        for (int r = 0; r < rows; r++) load(sum[r], out + width * (first + r));
        for (int i = 0; i < width; i++) {
            V v;
            load(v, y + width * i);
            PALPATE_UNROLL
            for (int r = 0; r < rows; r++) take(sum[r], L[width * (first + r) + i], v);
        }
        PALPATE_UNROLL
        for (int r = 0; r < rows; r++) store(out + width * (first + r), sum[r]);
    }
}

// x = M x, or M' x where `transposed`, for a lower triangular tile M (an inverted diagonal tile).
template <class T, bool transposed> PALPATE_INLINE void apply_tile(const T* M, T* x) {
    using V = typename Vector<T>::type;
    for (int step = 0; step < width; step++) {
        const int i = transposed ? step : width - 1 - step;
        V sum{};
        const int begin = transposed ? i : 0, end = transposed ? width : i + 1;
        for (int j = begin; j < end; j++) {
            V v;
            load(v, x + width * j);
            add(sum, transposed ? M[width * i + j] : M[width * j + i], v);
        }
        store(x + width * i, sum);
    }
}

template <class T> PALPATE_INLINE void forward_node(const T* L, const Triangle& n, int groups, T* own, T* below) {
    const int64_t size = int64_t(tile) * n.own; // of a group's own unknowns
    for (int p = 0; p < n.own; p++) {
        for (int g = 0; g < groups; g++) {
            T* mine = own + g * size;
            subtract_rows(L, width * p, mine, mine + tile * p);
            apply_tile<T, false>(L + int64_t(tile) * p, mine + tile * p);
        }
        L += int64_t(tile) * (p + 1);
    }
    for (int p = 0; p < n.below; p++, L += size)
        for (int g = 0; g < groups; g++)
            subtract_rows(L, width * n.own, own + g * size, below + int64_t(tile) * (g * n.below + p));
}

template <class T>
PALPATE_INLINE void backward_node(const T* L, const Triangle& n, int groups, T* own, const T* below) {
    const int64_t size = int64_t(tile) * n.own;
    const T* triangle = L;
    L += int64_t(tile) * n.own * (n.own + 1) / 2;
    for (int p = 0; p < n.below; p++, L += size)
        for (int g = 0; g < groups; g++)
            for (int q = 0; q < n.own; q++)
                subtract_columns(L + tile * q, below + int64_t(tile) * (g * n.below + p), own + g * size + tile * q);
    for (int p = n.own - 1; p >= 0; p--) {
        const T* row = triangle + int64_t(tile) * p * (p + 1) / 2;
        for (int g = 0; g < groups; g++) {
            T* mine = own + g * size;
            apply_tile<T, true>(row + int64_t(tile) * p, mine + tile * p);
            for (int q = 0; q < p; q++) subtract_columns(row + tile * q, mine + tile * p, mine + tile * q);
        }
    }
}

// out (8) -= L x for one right-hand side; four sums at a time, so that no addition waits for the last.
template <class T> PALPATE_INLINE void subtract_row_one(const T* L, int64_t depth, const T* x, T* out) {
    using V = typename Vector<T>::type;
    V a{}, b{}, c{}, d{};
    for (int64_t k = 0; k < depth; k += 4) { // depth is a multiple of 8
        V p, q, r, s;
        load(p, L + width * k), load(q, L + width * k + width);
        load(r, L + width * k + 2 * width), load(s, L + width * k + 3 * width);
        add(a, x[k], p), add(b, x[k + 1], q), add(c, x[k + 2], r), add(d, x[k + 3], s);
    }
    plus(a, b), plus(c, d), plus(a, c);
    V v;
    load(v, out);
    take(v, T(1), a);
    store(out, v);
}

template <class T> PALPATE_INLINE void forward_one_node(const T* L, const Triangle& n, T* own, T* below) {
    for (int p = 0; p < n.own; p++) {
        T* mine = own + width * p;
        subtract_row_one(L, width * p, own, mine);
        L += int64_t(tile) * p;
        typename Vector<T>::type sum{}, v;
        for (int k = 0; k < width; k++) load(v, L + width * k), add(sum, mine[k], v);
        store(mine, sum);
        L += tile;
    }
    for (int p = 0; p < n.below; p++, L += int64_t(tile) * n.own)
        subtract_row_one(L, width * n.own, own, below + width * p);
}

// sums: (8 own, 8) partial sums of L' y, added up at the end.
template <class T>
PALPATE_INLINE void backward_one_node(const T* L, const Triangle& n, T* own, const T* below, T* sums) {
    using V = typename Vector<T>::type;
    const T* triangle = L;
    L += int64_t(tile) * n.own * (n.own + 1) / 2;
    const int64_t size = width * n.own;
    std::fill_n(sums, width * size, T(0));
    auto gather = [&](const T* L, int64_t columns, const T* y) __attribute__((always_inline)) {
        V v;
        load(v, y);
        for (int64_t k = 0; k < columns; k++) {
            V s, l;
            load(s, sums + width * k), load(l, L + width * k);
            multiply(l, v), plus(s, l);
            store(sums + width * k, s);
        }
    };
    for (int p = 0; p < n.below; p++, L += width * size) gather(L, size, below + width * p);
    for (int p = n.own - 1; p >= 0; p--) {
        const T* row = triangle + int64_t(tile) * p * (p + 1) / 2;
        T right[width];
        for (int k = 0; k < width; k++) {
            V s;
            load(s, sums + width * (width * p + k));
            right[k] = own[width * p + k] - sum(s);
        }
        V r;
        load(r, right);
        for (int k = 0; k < width; k++) {
            V l;
            load(l, row + int64_t(tile) * p + width * k);
            multiply(l, r);
            own[width * p + k] = sum(l);
        }
        gather(row, width * p, own + width * p);
    }
}

} // namespace

PALPATE_KERNEL void forward(const float* L, const Triangle& n, int groups, float* own, float* below) {
    forward_node(L, n, groups, own, below);
}
PALPATE_KERNEL void backward(const float* L, const Triangle& n, int groups, float* own, const float* below) {
    backward_node(L, n, groups, own, below);
}
PALPATE_KERNEL void forward_one(const float* L, const Triangle& n, float* own, float* below) {
    forward_one_node(L, n, own, below);
}
PALPATE_KERNEL void backward_one(const float* L, const Triangle& n, float* own, const float* below, float* sums) {
    backward_one_node(L, n, own, below, sums);
}
PALPATE_KERNEL void forward(const double* L, const Triangle& n, int groups, double* own, double* below) {
    forward_node(L, n, groups, own, below);
}
PALPATE_KERNEL void backward(const double* L, const Triangle& n, int groups, double* own, const double* below) {
    backward_node(L, n, groups, own, below);
}
PALPATE_KERNEL void forward_one(const double* L, const Triangle& n, double* own, double* below) {
    forward_one_node(L, n, own, below);
}
PALPATE_KERNEL void backward_one(const double* L, const Triangle& n, double* own, const double* below, double* sums) {
    backward_one_node(L, n, own, below, sums);
}

} // namespace palpate
