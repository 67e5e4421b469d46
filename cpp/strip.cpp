#include "strip.h"
#include "interleave.h"
#include <algorithm>

namespace palpate {
namespace {

// out[q * pitch + a] = Σ over rows of weight · image, for `count` weights a row, `step` apart from row to row, that go
// with one image. fixed: the number of rows, or 0 for any.
template <int count, int fixed>
PALPATE_INLINE void reduce_image(const float* image, int64_t stride, const float* weight, int step, int rows, int n,
                                 float* out, int64_t pitch) {
    if constexpr (fixed == 0) {
        for (int a = 0; a < n; a += lanes)
            for (int q = 0; q < count; q++) {
                Lanes sum = {}, u;
                for (int t = 0; t < rows; t++) {
                    load(u, image + t * stride + a);
                    sum += weight[t * step + q] * u;
                }
                store(out + q * pitch + a, sum);
            }
    } else {
        float w[fixed][count];
        PALPATE_UNROLL
        for (int t = 0; t < fixed; t++) PALPATE_UNROLL
        for (int q = 0; q < count; q++) w[t][q] = weight[t * step + q];
        for (int a = 0; a < n; a += lanes) {
            Lanes sum[count], u;
            load(u, image + a);
            PALPATE_UNROLL
            for (int q = 0; q < count; q++) sum[q] = w[0][q] * u;
            PALPATE_UNROLL
            for (int t = 1; t < fixed; t++) {
                load(u, image + t * stride + a);
                PALPATE_UNROLL
                for (int q = 0; q < count; q++) sum[q] += w[t][q] * u;
            }
            PALPATE_UNROLL
            for (int q = 0; q < count; q++) store(out + q * pitch + a, sum[q]);
        }
    }
}

// Sums of slope for every term, then of curvature for every pair of terms.
template <int terms, int fixed>
PALPATE_INLINE void reduce_rows(const float* slope, const float* curvature, int64_t stride, const float* weight,
                                int rows, int n, float* out, int64_t pitch) {
    constexpr int pairs = pairs_of(terms), step = terms + pairs;
    reduce_image<terms, fixed>(slope, stride, weight, step, rows, n, out, pitch);
    reduce_image<pairs, fixed>(curvature, stride, weight + terms, step, rows, n, out + terms * pitch, pitch);
}

template <int terms>
PALPATE_INLINE void reduce_terms(const float* slope, const float* curvature, int64_t stride, const float* weight,
                                 int rows, int n, float* out, int64_t pitch) {
    switch (rows) {
    case 2:
        return reduce_rows<terms, 2>(slope, curvature, stride, weight, rows, n, out, pitch);
    case 3:
        return reduce_rows<terms, 3>(slope, curvature, stride, weight, rows, n, out, pitch);
    case 4:
        return reduce_rows<terms, 4>(slope, curvature, stride, weight, rows, n, out, pitch);
    case 5:
        return reduce_rows<terms, 5>(slope, curvature, stride, weight, rows, n, out, pitch);
    case 6:
        return reduce_rows<terms, 6>(slope, curvature, stride, weight, rows, n, out, pitch);
    default:
        return reduce_rows<terms, 0>(slope, curvature, stride, weight, rows, n, out, pitch);
    }
}

PALPATE_KERNEL void reduce(const float* slope, const float* curvature, int64_t stride, const float* weight, int terms,
                           int rows, int n, float* out, int64_t pitch) {
    if (terms == 1) return reduce_terms<1>(slope, curvature, stride, weight, rows, n, out, pitch);
    if (terms == 2) return reduce_terms<2>(slope, curvature, stride, weight, rows, n, out, pitch);
    if (terms == 3) return reduce_terms<3>(slope, curvature, stride, weight, rows, n, out, pitch);
    const int size = terms + pairs_of(terms);
    for (int q = 0; q < size; q++)
        reduce_image<1, 0>(q < terms ? slope : curvature, stride, weight + q, size, rows, n, out + q * pitch, pitch);
}

// slope += curvature · Σ over terms of weight · change, in the same rows and columns. terms, fixed (rows): 0 for any.
template <int terms, int fixed>
PALPATE_INLINE void expand_rows(const float* change, int64_t pitch, const float* curvature, int64_t stride,
                                const float* weight, int any, int rows, int n, float* slope) {
    if constexpr (terms == 0 || fixed == 0) {
        const int size = any + pairs_of(any);
        for (int t = 0; t < rows; t++, weight += size, curvature += stride, slope += stride)
            for (int a = 0; a < n; a += lanes) {
                Lanes sum = {}, p, c, g;
                for (int m = 0; m < any; m++) {
                    load(p, change + m * pitch + a);
                    sum += weight[m] * p;
                }
                load(c, curvature + a);
                load(g, slope + a);
                g += c * sum;
                store(slope + a, g);
            }
    } else {
        constexpr int size = terms + pairs_of(terms);
        float w[fixed][terms];
        PALPATE_UNROLL
        for (int t = 0; t < fixed; t++) PALPATE_UNROLL
        for (int m = 0; m < terms; m++) w[t][m] = weight[t * size + m];
        for (int a = 0; a < n; a += lanes) {
            Lanes p[terms];
            PALPATE_UNROLL
            for (int m = 0; m < terms; m++) load(p[m], change + m * pitch + a);
            PALPATE_UNROLL
            for (int t = 0; t < fixed; t++) {
                Lanes sum = w[t][0] * p[0], c, g;
                PALPATE_UNROLL
                for (int m = 1; m < terms; m++) sum += w[t][m] * p[m];
                load(c, curvature + t * stride + a);
                load(g, slope + t * stride + a);
                g += c * sum;
                store(slope + t * stride + a, g);
            }
        }
    }
}

template <int terms>
PALPATE_INLINE void expand_terms(const float* change, int64_t pitch, const float* curvature, int64_t stride,
                                 const float* weight, int any, int rows, int n, float* slope) {
    switch (rows) {
    case 2:
        return expand_rows<terms, 2>(change, pitch, curvature, stride, weight, any, rows, n, slope);
    case 3:
        return expand_rows<terms, 3>(change, pitch, curvature, stride, weight, any, rows, n, slope);
    case 4:
        return expand_rows<terms, 4>(change, pitch, curvature, stride, weight, any, rows, n, slope);
    case 5:
        return expand_rows<terms, 5>(change, pitch, curvature, stride, weight, any, rows, n, slope);
    case 6:
        return expand_rows<terms, 6>(change, pitch, curvature, stride, weight, any, rows, n, slope);
    default:
        return expand_rows<terms, 0>(change, pitch, curvature, stride, weight, any, rows, n, slope);
    }
}

PALPATE_KERNEL void expand(const float* change, int64_t pitch, const float* curvature, int64_t stride,
                           const float* weight, int terms, int rows, int n, float* slope) {
    if (terms == 1) return expand_terms<1>(change, pitch, curvature, stride, weight, terms, rows, n, slope);
    if (terms == 2) return expand_terms<2>(change, pitch, curvature, stride, weight, terms, rows, n, slope);
    if (terms == 3) return expand_terms<3>(change, pitch, curvature, stride, weight, terms, rows, n, slope);
    expand_rows<0, 0>(change, pitch, curvature, stride, weight, terms, rows, n, slope);
}

// Columns under voxels begin .. end - 1, whole vectors, and how far apart a row's sums are kept.
struct Reach {
    int from, n;
    int64_t pitch;

    Reach(const Bands& bands, int begin, int end)
        : from(bands.begin(begin)), n((std::max(0, bands.end(end - 1) - from) + lanes - 1) / lanes * lanes),
          pitch(n + 2 * Bands::beside) {}
};

} // namespace

void SliceView::make(const Geometry& geometry, const View& chosen, int z) {
    const Layout layout(chosen);
    view = &chosen;
    stride = layout.stride;
    weights.resize(chosen.moments);
    along_columns.clear();
    const Axis x = chosen.swapped ? Axis::y : Axis::x, y = chosen.swapped ? Axis::x : Axis::y;
    const bool turned = chosen.pose == Pose::turned;
    std::vector<bool> needed(chosen.moments + 1, false);
    for (int row = 0; row < geometry.grid.ny; row++) needed[chosen.moments_of(row)] = true;
    View fewer = chosen;
    for (int m = 1; m <= chosen.moments; m++) {
        if (!needed[m]) continue;
        fewer.moments = m;
        weights[m - 1].bands.make(geometry, fewer, z, x, layout.columns);
        if (!turned) weights[m - 1].along_y.make(geometry, fewer, z, y);
    }
    for (int s = 0; turned && s < products(chosen); s++) along_columns.push_back(edges(geometry, chosen, z, s));
}

int SliceView::moments_of(const Strip& strip) const {
    int most = 1;
    for (int i = 0; i < strip.rows; i++) most = std::max(most, view->moments_of(strip.y[i]));
    return most;
}

void SliceView::gather(const Strip& strip, const float* slope, const float* curvature, int begin, int end,
                       Columns& columns, Buffer& rows, Planes& planes) const {
    const Bands& along = bands(columns.moments);
    columns.walk.bands = nullptr;
    if (!along.sees(begin, end)) return;
    const Reach at(along, begin, end);
    const int terms = along.products(), size = terms + pairs_of(terms);
    const int64_t row = size * at.pitch;
    rows.resize(std::max(rows.size(), size_t(lanes * row)));
    float* sums = rows.data() + Bands::beside;
    for (int i = 0; i < strip.rows; i++)
        add_up(strip, i, slope, curvature, at.from, at.n, columns, sums + i * row, at.pitch);
    if (!along.walked())
        return along.look({sums, row, at.pitch, planes.of(0, 0), Planes::pitch, lanes * Planes::pitch, strip.rows},
                          at.from, begin, end);
    Walk& walk = columns.walk;
    walk.start(along, at.from, at.n);
    const float* from[lanes];
    for (int q = 0; q < size; q++) {
        for (int i = 0; i < strip.rows; i++) from[i] = sums + i * row + q * at.pitch;
        into_lanes(from, strip.rows, at.n, walk.sums.data() + q * lanes, size);
    }
}

void SliceView::add_up(const Strip& strip, int i, const float* slope, const float* curvature, int from, int n,
                       Columns& columns, float* sums, int64_t pitch) const {
    const int y = strip.y[i];
    if (view->pose == Pose::turned) {
        columns.turned[i].make(along_columns, y, view->nb, view->na, from, from + n);
        turned_reduce(columns.turned[i], slope, curvature, stride, products(*view), from, n, sums, pitch);
    } else {
        const AxisTerms& along_y = weights[columns.moments - 1].along_y;
        const int64_t first = along_y.first[y] * stride + from;
        reduce(slope + first, curvature + first, stride, along_y.of(y), along_y.terms, along_y.count[y], n, sums,
               pitch);
    }
}

void SliceView::spread(const Strip& strip, const float* const* change, const float* curvature, int begin, int end,
                       Columns& columns, Buffer& rows, float* slope) const {
    const Bands& along = bands(columns.moments);
    if (!along.sees(begin, end)) return; // the nearest columns lie further off than the 0s beside the changes
    const Reach at(along, begin, end);
    const int64_t row = along.products() * at.pitch;
    float* sums = rows.data() + Bands::beside;
    if (along.walked()) {
        float* to[lanes];
        for (int m = 0; m < along.products(); m++) {
            for (int i = 0; i < strip.rows; i++) to[i] = sums + i * row + m * at.pitch;
            out_of_lanes(columns.walk.change.data() + m * lanes, strip.rows, at.n, to, along.products());
        }
    }
    for (int i = 0; i < strip.rows; i++) {
        if (!along.walked()) along.spread(change[i], begin, at.from, at.n, sums + i * row, at.pitch);
        hand_back(strip, i, sums + i * row, at.pitch, curvature, at.from, at.n, columns, slope);
    }
}

void SliceView::hand_back(const Strip& strip, int i, const float* sums, int64_t pitch, const float* curvature, int from,
                          int n, const Columns& columns, float* slope) const {
    if (view->pose == Pose::turned)
        return turned_expand(columns.turned[i], sums, pitch, curvature, stride, products(*view), from, n, slope);
    const AxisTerms& along_y = weights[columns.moments - 1].along_y;
    const int y = strip.y[i];
    const int64_t first = along_y.first[y] * stride + from;
    expand(sums, pitch, curvature + first, stride, along_y.of(y), along_y.terms, along_y.count[y], n, slope + first);
}

} // namespace palpate
