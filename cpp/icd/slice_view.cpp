#include "icd/slice_view.h"
#include "base/cpu_dispatch.h"
#include "base/simd_transpose.h"
#include "icd/view_layout.h"
#include <algorithm>

namespace palpate {
namespace {

// out[q * pitch + a] = Σ over rows of weight · image, for `count` weights a row, `step` apart from row to row. fixed:
// the number of rows, or 0 for any.
template <int count, int fixed>
PALPATE_INLINE void sum_rows(const float* image, int64_t stride, const float* weight, int step, int any, int n,
                             float* __restrict out, int64_t pitch) {
    const int rows = fixed ? fixed : any;
    float kept[fixed * count + 1]; // in registers
    for (int k = 0; k < fixed * count; k++) kept[k] = weight[k / count * step + k % count];
    for (int a = 0; a < n; a += lanes) {
        f32x8 sum[count] = {}, u;
        PALPATE_UNROLL
        for (int t = 0; t < rows; t++) {
            load(u, image + t * stride + a);
            PALPATE_UNROLL
            for (int q = 0; q < count; q++) sum[q] += (fixed ? kept[t * count + q] : weight[t * step + q]) * u;
        }
        PALPATE_UNROLL
        for (int q = 0; q < count; q++) store(out + q * pitch + a, sum[q]);
    }
}

template <int count>
PALPATE_INLINE void sum_rows(const float* image, int64_t stride, const float* weight, int step, int rows, int n,
                             float* out, int64_t pitch) {
    if (rows == 2) return sum_rows<count, 2>(image, stride, weight, step, rows, n, out, pitch);
    if (rows == 3) return sum_rows<count, 3>(image, stride, weight, step, rows, n, out, pitch);
    if (rows == 4) return sum_rows<count, 4>(image, stride, weight, step, rows, n, out, pitch);
    sum_rows<count, 0>(image, stride, weight, step, rows, n, out, pitch);
}

// Sums of slope for every term, then of curvature for every pair of terms.
PALPATE_KERNEL void reduce(const float* slope, const float* curvature, int64_t stride, const float* weight, int terms,
                           int rows, int n, float* out, int64_t pitch) {
    const int step = terms + pairs_of(terms);
    if (terms == 2) {
        sum_rows<2>(slope, stride, weight, step, rows, n, out, pitch);
        sum_rows<3>(curvature, stride, weight + 2, step, rows, n, out + 2 * pitch, pitch);
    } else {
        for (int q = 0; q < step; q++)
            sum_rows<1>(q < terms ? slope : curvature, stride, weight + q, step, rows, n, out + q * pitch, pitch);
    }
}

// slope += curvature · Σ over terms of weight · change, in the same rows and columns. terms_, rows_: 0 for any.
template <int terms_, int rows_>
PALPATE_INLINE void expand_rows(const float* change, int64_t pitch, const float* curvature, int64_t stride,
                                const float* weight, int any_terms, int any_rows, int n, float* __restrict slope) {
    const int terms = terms_ ? terms_ : any_terms, rows = rows_ ? rows_ : any_rows, step = terms + pairs_of(terms);
    float kept[rows_ * terms_ + 1]; // in registers
    for (int k = 0; k < rows_ * terms_; k++) kept[k] = weight[k / terms * step + k % terms];
    for (int a = 0; a < n; a += lanes) {
        PALPATE_UNROLL
        for (int t = 0; t < rows; t++) {
            f32x8 sum = {}, p, c, g;
            PALPATE_UNROLL
            for (int m = 0; m < terms; m++) {
                load(p, change + m * pitch + a);
                sum += (rows_ * terms_ ? kept[t * terms + m] : weight[t * step + m]) * p;
            }
            load(c, curvature + t * stride + a);
            load(g, slope + t * stride + a);
            g += c * sum;
            store(slope + t * stride + a, g);
        }
    }
}

template <int terms>
PALPATE_INLINE void expand_terms(const float* change, int64_t pitch, const float* curvature, int64_t stride,
                                 const float* weight, int any, int rows, int n, float* slope) {
    if (rows == 2) return expand_rows<terms, 2>(change, pitch, curvature, stride, weight, any, rows, n, slope);
    if (rows == 3) return expand_rows<terms, 3>(change, pitch, curvature, stride, weight, any, rows, n, slope);
    if (rows == 4) return expand_rows<terms, 4>(change, pitch, curvature, stride, weight, any, rows, n, slope);
    expand_rows<terms, 0>(change, pitch, curvature, stride, weight, any, rows, n, slope);
}

PALPATE_KERNEL void expand(const float* change, int64_t pitch, const float* curvature, int64_t stride,
                           const float* weight, int terms, int rows, int n, float* slope) {
    if (terms == 1) return expand_terms<1>(change, pitch, curvature, stride, weight, terms, rows, n, slope);
    if (terms == 2) return expand_terms<2>(change, pitch, curvature, stride, weight, terms, rows, n, slope);
    expand_rows<0, 0>(change, pitch, curvature, stride, weight, terms, rows, n, slope);
}

} // namespace

void SliceView::make(const ScanGeometry& geometry, const View& chosen, int z) {
    view = &chosen;
    stride = ViewLayout(chosen).stride;
    along_x.make(geometry, chosen, z, chosen.swapped ? Axis::y : Axis::x);
    along_columns.clear();
    if (chosen.orientation == PanelOrientation::rotated)
        for (int s = 0; s < products(chosen); s++) along_columns.push_back(row_edges(geometry, chosen, z, s));
    else
        along_y.make(geometry, chosen, z, chosen.swapped ? Axis::x : Axis::y);
}

void SliceView::gather(const RowGroup& group, const float* slope, const float* curvature, int begin, int end,
                       ColumnSums& columns, SliceViewScratch& s) const {
    columns.start(along_x, begin, end);
    const int terms = along_x.terms, size = along_x.stride(), from = columns.from, n = columns.n;
    if (n == 0) return;
    s.rows.resize(std::max(s.rows.size(), size_t(lanes) * size * n));
    for (int i = 0; i < group.rows; i++) {
        const int y = group.y[i];
        float* out = s.rows.data() + int64_t(i) * size * n;
        if (view->orientation == PanelOrientation::rotated) {
            s.rotated[i].make(along_columns, y, view->nb, view->na, from, from + n);
            rotated_reduce(s.rotated[i], slope, curvature, stride, terms, from, n, out, n);
        } else {
            const int64_t first = along_y.first[y] * stride + from;
            reduce(slope + first, curvature + first, stride, along_y.of(y), terms, along_y.count[y], n, out, n);
        }
    }
    const float* rows[lanes];
    for (int q = 0; q < size; q++) {
        for (int i = 0; i < group.rows; i++) rows[i] = s.rows.data() + (int64_t(i) * size + q) * n;
        into_lanes(rows, group.rows, n, columns.sums.data() + q * lanes, size);
    }
}

void SliceView::spread(const RowGroup& group, const ColumnSums& columns, const float* curvature, SliceViewScratch& s,
                       float* slope) const {
    const int terms = along_x.terms, from = columns.from, n = columns.n;
    if (n == 0) return;
    float* rows[lanes];
    for (int m = 0; m < terms; m++) {
        for (int i = 0; i < group.rows; i++) rows[i] = s.rows.data() + (int64_t(i) * terms + m) * n;
        out_of_lanes(columns.change.data() + m * lanes, group.rows, n, rows, terms);
    }
    for (int i = 0; i < group.rows; i++) {
        const float* change = s.rows.data() + int64_t(i) * terms * n;
        if (view->orientation == PanelOrientation::rotated) {
            rotated_expand(s.rotated[i], change, n, curvature, stride, terms, from, n, slope);
        } else {
            const int y = group.y[i];
            const int64_t first = along_y.first[y] * stride + from;
            expand(change, n, curvature + first, stride, along_y.of(y), terms, along_y.count[y], n, slope + first);
        }
    }
}

} // namespace palpate
