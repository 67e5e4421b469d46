#include "linalg/frontal_matrix.h"
#include "base/cpu_dispatch.h"
#include "base/simd.h"
#include "base/thread_pool.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int width = FrontalMatrix::panel, tile = width * width;
constexpr int strip = 12;   // panels eliminated at a time: 96 columns of a panel are 6 KB of the 32 KB nearest cache
constexpr int together = 3; // panels that share what is read of another

// c -= A B' for a tile of 8 rows and 4 columns; a, b: 8 numbers a column of A and B, of which b's first four count.
// Numerical kernel.
#ifdef __wasm__ // whose engines have registers for a half of it
PALPATE_INLINE void subtract_half(const double* a, const double* b, int64_t depth, double* c) {
    f64x4 c0, c1, c2, c3, x;
    load(c0, c), load(c1, c + 8), load(c2, c + 16), load(c3, c + 24);
    for (int64_t k = 0; k < depth; k++, a += width, b += width) {
        load(x, a);
        c0 -= x * b[0], c1 -= x * b[1], c2 -= x * b[2], c3 -= x * b[3];
    }
    store(c, c0), store(c + 8, c1), store(c + 16, c2), store(c + 24, c3);
}
PALPATE_INLINE void subtract_product(const double* a, const double* b, int64_t depth, double* c) {
    subtract_half(a, b, depth, c);
    subtract_half(a + 4, b, depth, c + 4);
}
#else
PALPATE_INLINE void subtract_product(const double* a, const double* b, int64_t depth, double* c) {
    f64x4 c00, c01, c10, c11, c20, c21, c30, c31;
    load(c00, c), load(c01, c + 4), load(c10, c + 8), load(c11, c + 12);
    load(c20, c + 16), load(c21, c + 20), load(c30, c + 24), load(c31, c + 28);
    for (int64_t k = 0; k < depth; k++, a += width, b += width) {
        f64x4 x, y;
        load(x, a), load(y, a + 4);
        const double b0 = b[0], b1 = b[1], b2 = b[2], b3 = b[3];
        c00 -= x * b0, c01 -= y * b0, c10 -= x * b1, c11 -= y * b1;
        c20 -= x * b2, c21 -= y * b2, c30 -= x * b3, c31 -= y * b3;
    }
    store(c, c00), store(c + 4, c01), store(c + 8, c10), store(c + 12, c11);
    store(c + 16, c20), store(c + 20, c21), store(c + 24, c30), store(c + 28, c31);
}
#endif

// c = c L^-T for a tile c and the factored diagonal tile L.
PALPATE_INLINE void solve_tile(const double* L, const double* reciprocal, double* c) {
    for (int j = 0; j < width; j++) {
        f64x4 x, y;
        load(x, c + width * j), load(y, c + width * j + 4);
        for (int k = 0; k < j; k++) {
            f64x4 p, q;
            load(p, c + width * k), load(q, c + width * k + 4);
            const double f = L[width * k + j];
            x -= p * f, y -= q * f;
        }
        x *= reciprocal[j], y *= reciprocal[j];
        store(c + width * j, x), store(c + width * j + 4, y);
    }
}

// The diagonal tile in place. Its columns' reciprocal pivots serve the tiles below it.
PALPATE_INLINE bool factor_tile(double* c, double* reciprocal) {
    for (int j = 0; j < width; j++) {
        double pivot = c[width * j + j];
        for (int k = 0; k < j; k++) pivot -= c[width * k + j] * c[width * k + j];
        if (!(pivot > 0) || !(pivot < 1e300)) return false;
        const double root = std::sqrt(pivot);
        c[width * j + j] = root;
        reciprocal[j] = 1 / root;
        for (int i = j + 1; i < width; i++) {
            double sum = c[width * j + i];
            for (int k = 0; k < j; k++) sum -= c[width * k + i] * c[width * k + j];
            c[width * j + i] = sum * reciprocal[j];
        }
    }
    return true;
}

// One panel's columns of the strip [begin, end), left to right.
PALPATE_KERNEL bool solve_panel(const FrontalMatrix& front, int p, int begin, int end, double* reciprocal) {
    double* mine = front.at(p);
    for (int q = begin; q < end && q <= p; q++) {
        const double* other = front.at(q);
        double* c = mine + int64_t(tile) * q;
        const int64_t from = int64_t(tile) * begin, depth = width * (q - begin);
        subtract_product(mine + from, other + from, depth, c);
        subtract_product(mine + from, other + from + 4, depth, c + 4 * width);
        if (q < p)
            solve_tile(other + int64_t(tile) * q, reciprocal + width * q, c);
        else if (!factor_tile(c, reciprocal + width * q))
            return false;
    }
    return true;
}

// What the strip [begin, end) takes from the columns to its right, for panels first .. last.
PALPATE_KERNEL void update_panels(const FrontalMatrix& front, int first, int last, int begin, int end) {
    const int64_t from = int64_t(tile) * begin, depth = width * (end - begin);
    for (int q = end; q < last; q++) {
        const double* other = front.at(q) + from;
        for (int p = std::max(first, q); p < last; p++) {
            double* mine = front.at(p);
            double* c = mine + int64_t(tile) * q;
            subtract_product(mine + from, other, depth, c);
            subtract_product(mine + from, other + 4, depth, c + 4 * width);
        }
    }
}

// The inverse of a lower triangular tile, column by column.
void invert_tile(const double* L, double* out) {
    std::fill_n(out, tile, 0.0);
    for (int j = 0; j < width; j++) {
        out[width * j + j] = 1 / L[width * j + j];
        for (int i = j + 1; i < width; i++) {
            double sum = 0;
            for (int k = j; k < i; k++) sum += L[width * k + i] * out[width * j + k];
            out[width * j + i] = -sum / L[width * i + i];
        }
    }
}

} // namespace

bool eliminate(const FrontalMatrix& front, int own, double* inverse) {
    double* reciprocal = inverse;                                         // until the tiles are inverted
    const bool large = double(own) * front.panels * front.panels > 20000; // 10 Mflop: worth waking threads
    for (int begin = 0; begin < own; begin += strip) {
        const int end = std::min(own, begin + strip);
        for (int p = begin; p < end; p++)
            if (!solve_panel(front, p, begin, end, reciprocal)) return false;
        const int groups = (front.panels - end + together - 1) / together;
        auto solve = [&](int64_t g) {
            for (int p = end + int(g) * together; p < std::min(front.panels, end + int(g + 1) * together); p++)
                solve_panel(front, p, begin, end, reciprocal);
        };
        auto update = [&](int64_t g) { // the longest first
            const int first = end + int(groups - 1 - g) * together;
            update_panels(front, first, std::min(front.panels, first + together), begin, end);
        };
        if (large) {
            parallel_tasks(groups, [&](int64_t g, int) { solve(g); });
            parallel_tasks(groups, [&](int64_t g, int) { update(g); });
        } else {
            for (int g = 0; g < groups; g++) solve(g);
            for (int g = 0; g < groups; g++) update(g);
        }
    }
    for (int p = own - 1; p >= 0; p--) invert_tile(front.at(p) + int64_t(tile) * p, inverse + int64_t(tile) * p);
    return true;
}

} // namespace palpate
