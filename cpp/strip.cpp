#include "strip.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr int chunk = 256; // columns whose sums stay in the nearest cache

// out = Σ of weight · image over `taps` rows, in n columns, for the images and weights that go with each term and pair
// of terms: out[q * pitch + a]. fixed: the number of taps, or 0 for any.
template <int fixed>
PALPATE_INLINE void reduce_rows(const float* slope, const float* curvature, int64_t stride, const float* weight,
                                int terms, int taps, int n, float* out, int64_t pitch) {
    const int size = terms + pairs_of(terms), count = fixed ? fixed : taps;
    for (int q = 0; q < size; q++, out += pitch) {
        const float* image = q < terms ? slope : curvature;
        float w[fixed ? fixed : 1];
        for (int t = 0; t < fixed; t++) w[t] = weight[t * size + q];
        for (int a = 0; a < n; a += 2 * lanes) {
            Lanes first = {}, second = {}, u, v;
            for (int t = 0; t < count; t++) {
                const float by = fixed ? w[fixed ? t : 0] : weight[t * size + q];
                load(u, image + t * stride + a);
                load(v, image + t * stride + a + lanes);
                first += by * u;
                second += by * v;
            }
            store(out + a, first);
            store(out + a + lanes, second);
        }
    }
}

PALPATE_KERNEL void reduce(const float* slope, const float* curvature, int64_t stride, const float* weight, int terms,
                           int taps, int n, float* out, int64_t pitch) {
    switch (taps) {
    case 2:
        return reduce_rows<2>(slope, curvature, stride, weight, terms, taps, n, out, pitch);
    case 3:
        return reduce_rows<3>(slope, curvature, stride, weight, terms, taps, n, out, pitch);
    case 4:
        return reduce_rows<4>(slope, curvature, stride, weight, terms, taps, n, out, pitch);
    case 5:
        return reduce_rows<5>(slope, curvature, stride, weight, terms, taps, n, out, pitch);
    default:
        return reduce_rows<0>(slope, curvature, stride, weight, terms, taps, n, out, pitch);
    }
}

// slope += curvature · Σ over terms of weight · change, in the same rows and columns.
template <int fixed>
PALPATE_INLINE void expand_rows(const float* change, int64_t pitch, const float* curvature, int64_t stride,
                                const float* weight, int any, int taps, int n, float* slope) {
    const int terms = fixed ? fixed : any, size = terms + pairs_of(terms);
    for (int t = 0; t < taps; t++, weight += size, curvature += stride, slope += stride)
        for (int a = 0; a < n; a += lanes) {
            Lanes sum = {}, p, c, g;
            for (int m = 0; m < terms; m++) {
                load(p, change + m * pitch + a);
                sum += weight[m] * p;
            }
            load(c, curvature + a);
            load(g, slope + a);
            g += c * sum;
            store(slope + a, g);
        }
}

PALPATE_KERNEL void expand(const float* change, int64_t pitch, const float* curvature, int64_t stride,
                           const float* weight, int terms, int taps, int n, float* slope) {
    switch (terms) {
    case 1:
        return expand_rows<1>(change, pitch, curvature, stride, weight, terms, taps, n, slope);
    case 2:
        return expand_rows<2>(change, pitch, curvature, stride, weight, terms, taps, n, slope);
    default:
        return expand_rows<0>(change, pitch, curvature, stride, weight, terms, taps, n, slope);
    }
}

// rows[(lane * size + q) * chunk + a] to cells[a * cell + q * lanes + lane], and 0 to the changes behind them.
PALPATE_KERNEL void into_cells(const float* rows, int size, int terms, int n, float* cells) {
    const int cell = (size + terms) * lanes;
    const Lanes zero = {};
    for (int a = 0; a < n; a += lanes) {
        for (int q = 0; q < size; q++) {
            Lanes m[lanes];
            load_each(m, rows + q * chunk + a, int64_t(size) * chunk);
            transpose(m);
            store_each(cells + int64_t(a) * cell + q * lanes, cell, m);
        }
        for (int i = 0; i < lanes; i++)
            for (int q = size; q < size + terms; q++) store(cells + int64_t(a + i) * cell + q * lanes, zero);
    }
}

// The changes in the cells to rows[(lane * terms + term) * chunk + a].
PALPATE_KERNEL void out_of_cells(const float* cells, int size, int terms, int n, float* rows) {
    const int cell = (size + terms) * lanes;
    for (int a = 0; a < n; a += lanes)
        for (int q = 0; q < terms; q++) {
            Lanes m[lanes];
            load_each(m, cells + int64_t(a) * cell + (size + q) * lanes, cell);
            transpose(m);
            store_each(rows + q * chunk + a, int64_t(terms) * chunk, m);
        }
}

} // namespace

void SliceView::make(const Geometry& geometry, const View& chosen, int z) {
    const Layout layout(chosen);
    view = &chosen;
    stride = layout.stride;
    ny = geometry.grid.ny;
    const Axis x = chosen.swapped ? Axis::y : Axis::x, y = chosen.swapped ? Axis::x : Axis::y;
    along_x.make(geometry, chosen, z, x, 2, layout.columns);
    if (chosen.pose == Pose::turned) {
        along_columns.clear();
        for (int s = 0; s < products(chosen); s++) along_columns.push_back(edges(geometry, chosen, z, s));
    } else {
        along_y.make(geometry, chosen, z, y, 1, 0);
    }
}

int SliceView::rows_apart() const {
    if (view->pose == Pose::turned) return turned_rows_apart(along_columns, ny, view->na);
    return along_y.apart(1);
}

void SliceView::gather(const Strip& strip, const float* slope, const float* curvature, int begin, int end,
                       Sums& sums) const {
    const int size = along_x.stride();
    sums.begin = along_x.first[begin] / lanes * lanes;
    const int columns = along_x.first[end - 1] + along_x.width - sums.begin;
    sums.end = sums.begin + (columns + 2 * lanes - 1) / (2 * lanes) * (2 * lanes);
    sums.cells.resize(std::max(sums.cells.size(), size_t(sums.end - sums.begin) * cell()));
    sums.rows.resize(std::max(sums.rows.size(), size_t(size) * lanes * chunk));
    if (view->pose == Pose::turned)
        for (int i = 0; i < strip.rows; i++)
            sums.turned[i].make(along_columns, strip.y[i], view->nb, view->na, sums.begin, sums.end);
    float* rows = sums.rows.data();
    for (int a = sums.begin; a < sums.end; a += chunk) {
        const int n = std::min(chunk, sums.end - a);
        for (int i = 0; i < lanes; i++) {
            float* out = rows + int64_t(i) * size * chunk;
            if (i >= strip.rows) {
                std::fill_n(out, size * chunk, 0.0f);
            } else if (view->pose == Pose::turned) {
                turned_reduce(sums.turned[i], slope, curvature, stride, terms(), a, n, out, chunk);
            } else {
                const int y = strip.y[i];
                const int64_t at = along_y.first[y] * stride + a;
                reduce(slope + at, curvature + at, stride, along_y.of(y), terms(), along_y.count[y], n, out, chunk);
            }
        }
        into_cells(rows, size, terms(), n, sums.cells.data() + int64_t(a - sums.begin) * cell());
    }
}

void SliceView::spread(const Strip& strip, const float* curvature, Sums& sums, float* slope) const {
    float* rows = sums.rows.data();
    for (int a = sums.begin; a < sums.end; a += chunk) {
        const int n = std::min(chunk, sums.end - a);
        out_of_cells(sums.cells.data() + int64_t(a - sums.begin) * cell(), along_x.stride(), terms(), n, rows);
        for (int i = 0; i < strip.rows; i++) {
            const float* change = rows + int64_t(i) * terms() * chunk;
            if (view->pose == Pose::turned) {
                turned_expand(sums.turned[i], change, chunk, curvature, stride, terms(), a, n, slope);
            } else {
                const int y = strip.y[i];
                const int64_t at = along_y.first[y] * stride + a;
                expand(change, chunk, curvature + at, stride, along_y.of(y), terms(), along_y.count[y], n, slope + at);
            }
        }
    }
}

} // namespace palpate
