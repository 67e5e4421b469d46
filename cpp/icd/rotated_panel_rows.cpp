#include "icd/rotated_panel_rows.h"
#include "base/simd.h"
#include "icd/axis_footprint.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// The rows of the image under voxel y in each vector of columns, of which the last may go beyond na.
PALPATE_KERNEL void find_rows(const RowEdges* edges, int terms, int y, int nb, int na, int begin, int vectors,
                              int32_t* __restrict low, int32_t* __restrict count) {
    for (int i = 0; i < vectors; i++) {
        const double a = begin + i * lanes, last = std::min(begin + i * lanes + lanes, na) - 1;
        double least = nb, most = 0;
        for (int m = 0; m < terms; m++) {
            const RowEdges& e = edges[m];
            least = std::min({least, e.at(y, a), e.at(y, last)});
            most = std::max({most, e.at(y + 1, a), e.at(y + 1, last)});
        }
        low[i] = int32_t(std::max(std::floor(least), 0.0));
        count[i] = std::max(0, int32_t(std::min(std::ceil(most), double(nb))) - low[i]);
    }
}

// The parts of pixels low[i], low[i] + 1, ... between the edges of voxel y, for each vector of columns; `step` floats
// from pixel to pixel. Positions are counted from low[i], so that float holds them.
PALPATE_KERNEL void weigh_columns(const RowEdges& e, int y, int begin, int vectors, const int32_t* low,
                                  const int32_t* count, int64_t vector_size, int64_t step, float* weight) {
    const double slope0 = e.slope_step * y + e.offset_step, slope1 = slope0 + e.slope_step;
    const double start0 = e.at(y, 0), start1 = e.at(y + 1, 0);
    const f32x8 zero = {}, ramp = {0, 1, 2, 3, 4, 5, 6, 7};
    const f32x8 step0 = ramp * float(slope0), step1 = ramp * float(slope1);
    for (int i = 0; i < vectors; i++, weight += vector_size) {
        const int a = begin + i * lanes;
        const f32x8 left = float(start0 + slope0 * a - low[i]) + step0;
        const f32x8 right = float(start1 + slope1 * a - low[i]) + step1;
        f32x8 pixel = zero;
        for (int t = 0; t < count[i]; t++) {
            const f32x8 end = pixel + 1.0f, part = (right < end ? right : end) - (left > pixel ? left : pixel);
            store(weight + t * step, part > zero ? part : zero);
            pixel = end;
        }
    }
}

// out[q * pitch] = Σ over rows of the weight of each term · slope, then of the product of each pair's · curvature.
template <int terms>
PALPATE_INLINE void reduce_vector(const float* slope, const float* curvature, int64_t stride, const float* weight,
                                  int count, float* out, int64_t pitch) {
    f32x8 first[terms] = {}, second[pairs_of(terms)] = {};
    for (int t = 0; t < count; t++, slope += stride, curvature += stride, weight += terms * lanes) {
        f32x8 w[terms], g, c;
        load(g, slope);
        load(c, curvature);
        PALPATE_UNROLL_UP_TO(4)
        for (int m = 0; m < terms; m++) load(w[m], weight + m * lanes);
        int pair = 0;
        PALPATE_UNROLL_UP_TO(4)
        for (int m = 0; m < terms; m++) {
            first[m] += w[m] * g;
            const f32x8 wc = w[m] * c;
            PALPATE_UNROLL_UP_TO(4)
            for (int k = m; k < terms; k++) second[pair++] += wc * w[k];
        }
    }
    PALPATE_UNROLL_UP_TO(4)
    for (int m = 0; m < terms; m++) store(out + m * pitch, first[m]);
    for (int m = 0; m < pairs_of(terms); m++) store(out + (terms + m) * pitch, second[m]);
}

// The same for any number of terms.
PALPATE_INLINE void reduce_any(const float* slope, const float* curvature, int64_t stride, const float* weight,
                               int terms, int count, float* out, int64_t pitch) {
    for (int m = 0; m < terms; m++)
        for (int k = m - 1; k < terms; k++) { // m - 1: the term alone
            const float* image = k < m ? slope : curvature;
            f32x8 sum = {}, w, other, x;
            for (int t = 0; t < count; t++) {
                load(w, weight + (t * terms + m) * lanes);
                load(x, image + t * stride);
                if (k >= m) load(other, weight + (t * terms + k) * lanes), w *= other;
                sum += w * x;
            }
            const int before = m * terms - m * (m - 1) / 2; // pairs of earlier terms
            store(out + (k < m ? m : terms + before + k - m) * pitch, sum);
        }
}

// slope += curvature · Σ over terms of weight · change.
template <int fixed>
PALPATE_INLINE void expand_vector(const float* change, int64_t pitch, const float* curvature, int64_t stride,
                                  const float* weight, int any, int count, float* slope) {
    const int terms = fixed ? fixed : any;
    for (int t = 0; t < count; t++, slope += stride, curvature += stride, weight += terms * lanes) {
        f32x8 sum = {}, w, p, c, g;
        for (int m = 0; m < terms; m++) {
            load(w, weight + m * lanes);
            load(p, change + m * pitch);
            sum += w * p;
        }
        load(c, curvature);
        load(g, slope);
        g += c * sum;
        store(slope, g);
    }
}

// How far the edges of the rows move over the columns of one vector, in rows of the image.
double edges_drift(const std::vector<RowEdges>& edges, int ny) {
    double most = 0;
    for (const RowEdges& e : edges)
        for (int y : {0, ny}) most = std::max(most, (lanes - 1) * std::fabs(e.slope_step * y + e.offset_step));
    return most;
}

} // namespace

void RotatedPanelRow::make(const std::vector<RowEdges>& edges, int y, int nb, int na, int first, int last) {
    begin = first;
    end = last;
    const int vectors = (end - begin + lanes - 1) / lanes, terms = int(edges.size());
    const int held = std::max(0, std::min(vectors, (na - begin + lanes - 1) / lanes));
    low.assign(vectors, 0);
    count.assign(vectors, 0); // no row beyond the last column
    find_rows(edges.data(), terms, y, nb, na, begin, held, low.data(), count.data());
    taps = held ? *std::max_element(count.begin(), count.end()) : 0;
    const int64_t vector_size = int64_t(taps) * terms * lanes;
    weight.resize(vectors * vector_size);
    for (int m = 0; m < terms; m++)
        weigh_columns(edges[m], y, begin, held, low.data(), count.data(), vector_size, terms * lanes,
                      weight.data() + m * lanes);
}

PALPATE_KERNEL void rotated_reduce(const RotatedPanelRow& row, const float* slope, const float* curvature,
                                   int64_t stride, int terms, int from, int n, float* out, int64_t pitch) {
    for (int a = from; a < from + n; a += lanes, out += lanes) {
        const int i = (a - row.begin) / lanes, count = row.count[i];
        const int64_t at = row.low[i] * stride + a;
        const float* weight = row.weight.data() + int64_t(i) * row.taps * terms * lanes;
        if (terms == 1)
            reduce_vector<1>(slope + at, curvature + at, stride, weight, count, out, pitch);
        else if (terms == 2)
            reduce_vector<2>(slope + at, curvature + at, stride, weight, count, out, pitch);
        else if (terms == 3)
            reduce_vector<3>(slope + at, curvature + at, stride, weight, count, out, pitch);
        else
            reduce_any(slope + at, curvature + at, stride, weight, terms, count, out, pitch);
    }
}

PALPATE_KERNEL void rotated_expand(const RotatedPanelRow& row, const float* change, int64_t pitch,
                                   const float* curvature, int64_t stride, int terms, int from, int n, float* slope) {
    for (int a = from; a < from + n; a += lanes, change += lanes) {
        const int i = (a - row.begin) / lanes, count = row.count[i];
        const int64_t at = row.low[i] * stride + a;
        const float* weight = row.weight.data() + int64_t(i) * row.taps * terms * lanes;
        if (terms == 1)
            expand_vector<1>(change, pitch, curvature + at, stride, weight, terms, count, slope + at);
        else if (terms == 2)
            expand_vector<2>(change, pitch, curvature + at, stride, weight, terms, count, slope + at);
        else
            expand_vector<0>(change, pitch, curvature + at, stride, weight, terms, count, slope + at);
    }
}

// In column a, row y of voxels covers up to the greatest edge y + 1, and row y + apart begins at the least edge
// y + apart: that gap is concave in y and in a, so it is least at a corner. The columns of a vector share their rows of
// the image, and either edge drifts over them.
int rotated_independent_step(const std::vector<RowEdges>& edges, int ny, int na) {
    const double drift = edges_drift(edges, ny);
    for (int apart = 1; apart < ny; apart++) {
        double gap = 1e300;
        for (int a : {0, na - 1})
            for (int y : {0, ny - apart}) {
                double end = -1e300, begin = 1e300;
                for (const RowEdges& e : edges) {
                    end = std::max(end, e.at(y + 1, a));
                    begin = std::min(begin, e.at(y + apart, a));
                }
                gap = std::min(gap, begin - end);
            }
        if (gap > 1 + 2 * drift) return apart;
    }
    return ny;
}

} // namespace palpate
