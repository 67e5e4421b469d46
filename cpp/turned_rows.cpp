#include "turned_rows.h"
#include "lanes.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int pairs_of(int terms) { return terms * (terms + 1) / 2; }

// Columns a .. a + 7, those beyond `last` taken for it: they hold nothing.
struct Vector {
    int a, behind;
    Lanes ramp;
    Vector(int a, int last) : a(a), behind(std::min(lanes - 1, last - a)) {
        for (int i = 0; i < lanes; i++) ramp[i] = float(std::min(i, behind));
    }
    double least(const Edges& e, double y) const { return std::min(e.at(y, a), e.at(y, a + behind)); }
    double most(const Edges& e, double y) const { return std::max(e.at(y, a), e.at(y, a + behind)); }
};

// The parts of pixels low, low + 1, ... between the edges of voxel y, `step` floats from pixel to pixel. Positions are
// counted from `low`, so that float holds them.
PALPATE_KERNEL void weigh_columns(const Edges& e, int y, const Vector& v, int low, int taps, int64_t step,
                                  float* weight) {
    const Lanes zero = {};
    const Lanes left = float(e.at(y, v.a) - low) + v.ramp * float(e.slope_step * y + e.offset_step);
    const Lanes right = float(e.at(y + 1, v.a) - low) + v.ramp * float(e.slope_step * (y + 1) + e.offset_step);
    for (int t = 0; t < taps; t++, weight += step) {
        const Lanes end = zero + float(t + 1), begin = zero + float(t);
        const Lanes part = (right < end ? right : end) - (left > begin ? left : begin);
        store(weight, part > zero ? part : zero);
    }
}

// out[q * pitch] = Σ over rows of the weight of each term · slope, then of the product of each pair's · curvature.
template <int terms>
PALPATE_INLINE void reduce_vector(const float* slope, const float* curvature, int64_t stride, const float* weight,
                                  int count, float* out, int64_t pitch) {
    Lanes first[terms] = {}, second[pairs_of(terms)] = {};
    for (int t = 0; t < count; t++, slope += stride, curvature += stride, weight += terms * lanes) {
        Lanes w[terms], g, c;
        load(g, slope);
        load(c, curvature);
#pragma GCC unroll 4
        for (int m = 0; m < terms; m++) load(w[m], weight + m * lanes);
        int pair = 0;
#pragma GCC unroll 4
        for (int m = 0; m < terms; m++) {
            first[m] += w[m] * g;
            const Lanes wc = w[m] * c;
#pragma GCC unroll 4
            for (int k = m; k < terms; k++) second[pair++] += wc * w[k];
        }
    }
#pragma GCC unroll 4
    for (int m = 0; m < terms; m++) store(out + m * pitch, first[m]);
#pragma GCC unroll 8
    for (int m = 0; m < pairs_of(terms); m++) store(out + (terms + m) * pitch, second[m]);
}

// The same for any number of terms.
PALPATE_INLINE void reduce_any(const float* slope, const float* curvature, int64_t stride, const float* weight,
                               int terms, int count, float* out, int64_t pitch) {
    for (int m = 0; m < terms; m++)
        for (int k = m - 1; k < terms; k++) { // m - 1: the term alone
            const float* image = k < m ? slope : curvature;
            Lanes sum = {}, w, other, x;
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
        Lanes sum = {}, w, p, c, g;
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
double edges_drift(const std::vector<Edges>& edges, int ny) {
    double most = 0;
    for (const Edges& e : edges)
        for (int y : {0, ny}) most = std::max(most, (lanes - 1) * std::fabs(e.slope_step * y + e.offset_step));
    return most;
}

} // namespace

void TurnedRow::make(const std::vector<Edges>& edges, int y, int nb, int na, int first, int last) {
    begin = first;
    end = last;
    const int vectors = (end - begin + lanes - 1) / lanes, terms = int(edges.size());
    low.assign(vectors, 0);
    count.assign(vectors, 0); // no row beyond the last column
    taps = 0;
    for (int i = 0; i < vectors && begin + i * lanes < na; i++) {
        const Vector v(begin + i * lanes, na - 1);
        double least = nb, most = 0;
        for (const Edges& e : edges) {
            least = std::min(least, v.least(e, y));
            most = std::max(most, v.most(e, y + 1));
        }
        low[i] = int(std::max(std::floor(least), 0.0));
        count[i] = std::max(0, int(std::min(std::ceil(most), double(nb))) - low[i]);
        taps = std::max(taps, count[i]);
    }
    weight.resize(size_t(vectors) * taps * terms * lanes);
    for (int i = 0; i < vectors; i++)
        for (int m = 0; m < terms && count[i] > 0; m++)
            weigh_columns(edges[m], y, Vector(begin + i * lanes, na - 1), low[i], count[i], terms * lanes,
                          &weight[(size_t(i) * taps * terms + m) * lanes]);
}

PALPATE_KERNEL void turned_reduce(const TurnedRow& row, const float* slope, const float* curvature, int64_t stride,
                                  int terms, int from, int n, float* out, int64_t pitch) {
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

PALPATE_KERNEL void turned_expand(const TurnedRow& row, const float* change, int64_t pitch, const float* curvature,
                                  int64_t stride, int terms, int from, int n, float* slope) {
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
int turned_rows_apart(const std::vector<Edges>& edges, int ny, int na) {
    const double drift = edges_drift(edges, ny);
    for (int apart = 1; apart < ny; apart++) {
        double gap = 1e300;
        for (int a : {0, na - 1})
            for (int y : {0, ny - apart}) {
                double end = -1e300, begin = 1e300;
                for (const Edges& e : edges) {
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
