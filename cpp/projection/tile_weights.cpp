#include "projection/tile_weights.h"

namespace palpate {
namespace {

constexpr int block = 16;

PALPATE_INLINE int32_t clamp_index(double x, int limit) { return int32_t(std::min(std::max(x, 0.0), double(limit))); }

// How far, in pixels, an edge may enter a pixel while the part that it cuts off is still truncated. `move` is how far
// the edge moves over the thickness. If it enters while it moves, it cuts off d² / (2 move), if it is faster d - move
// / 2.
double inset(double shift, double truncation) {
    return shift > 2 * truncation ? std::min(1.0, std::sqrt(2 * truncation * shift)) : truncation + 0.5 * shift;
}

// The smallest inset of elements from .. from + count, whose edges move by move + i * step, and of `over` more
// elements on either side.
double least_inset(double shift, double step, int from, int count, double over, double truncation) {
    const double first = shift + step * (from - over), last = shift + step * (from + count + over);
    const double least = (first < 0) != (last < 0) ? 0 : std::min(std::fabs(first), std::fabs(last));
    return 0.999 * inset(least, truncation);
}

} // namespace

// The voxels that project onto pixel from + i: first[i] .. last[i] - 1.
PALPATE_KERNEL void find_voxels(const EdgeProjection& s, double inset, int from, int count, int voxels,
                                int32_t* __restrict first, int32_t* __restrict last) {
    const double per0 = 1 / s.slope[0], per1 = 1 / s.slope[1], in = inset * std::min(per0, per1);
    for (int i = 0; i < count; i++) {
        const double a = from + i, v0 = (a - s.offset[0]) * per0, v1 = (a - s.offset[1]) * per1;
        const double low = std::min(v0, v1), high = std::max(v0 + per0, v1 + per1);
        first[i] = low < voxels ? clamp_index(std::floor(low + in), voxels - 1) : voxels;
        last[i] = high > 0 ? std::max(clamp_index(std::ceil(high - in), voxels), 1) : 0;
    }
}

// The pixels that voxel from + i projects onto: first[i] .. last[i] - 1.
PALPATE_KERNEL void find_pixels(const EdgeProjection& s, double inset, int from, int count, int pixels, int voxels,
                                int32_t* __restrict first, int32_t* __restrict last) {
    for (int i = 0; i < count; i++) {
        const double before = from + i == 0 ? 0 : inset, last_offset = from + i + 1 == voxels ? 0 : inset;
        const double p0 = s.offset[0] + s.slope[0] * (from + i), p1 = s.offset[1] + s.slope[1] * (from + i);
        first[i] = clamp_index(std::floor(std::min(p0, p1) + before), pixels);
        last[i] = clamp_index(std::ceil(std::max(p0 + s.slope[0], p1 + s.slope[1]) - last_offset), pixels);
    }
}

// Weights of a tile. Positions are counted from each element's first pixel or voxel, so that float is precise enough.
// The volume's outer edges are not truncated: outside there is no voxel that could get the part cut off.
template <int moments>
PALPATE_INLINE void voxel_weights_of_pixels_by(const EdgeProjection& s, int from, int count, int voxels, int taps,
                                               const int32_t* __restrict first, float* __restrict weight) {
    const float slope0 = float(s.slope[0]), slope1 = float(s.slope[1]);
    const float per_truncation = float(inverse_truncation(s.truncation)), none = float(no_truncation);
    for (int i0 = 0; i0 < count; i0 += block) {
        float start0[block], start1[block], before[moments][block];
        for (int i = 0; i < block; i++) {
            start0[i] = float(s.offset[0] + s.slope[0] * first[i0 + i] - (from + i0 + i));
            start1[i] = float(s.offset[1] + s.slope[1] * first[i0 + i] - (from + i0 + i));
        }
        for (int i = 0; i < block; i++) {
            float now[moments];
            legendre_moments(start0[i], start1[i], moments, first[i0 + i] == 0 ? none : per_truncation, now);
            for (int m = 0; m < moments; m++) before[m][i] = now[m];
        }
        for (int t = 1; t <= taps; t++)
            for (int i = 0; i < block; i++) {
                float now[moments];
                legendre_moments(start0[i] + float(t) * slope0, start1[i] + float(t) * slope1, moments,
                                 first[i0 + i] + t == voxels ? none : per_truncation, now);
                for (int m = 0; m < moments; m++) {
                    weight[(m * taps + t - 1) * tile_size + i0 + i] = now[m] - before[m][i];
                    before[m][i] = now[m];
                }
            }
    }
}

template <int moments>
PALPATE_INLINE void pixel_weights_of_voxels_by(const EdgeProjection& s, int from, int count, int voxels, int taps,
                                               const int32_t* __restrict first, float* __restrict weight) {
    for (int i0 = 0; i0 < count; i0 += block) {
        const float usual = float(inverse_truncation(s.truncation));
        float start[2][2][block], arrivals[2][block], per_truncation[2][block]; // of either edge
        for (int edge = 0; edge < 2; edge++)
            for (int i = 0; i < block; i++) {
                const int number = from + i0 + i + edge;
                const float p0 = float(s.offset[0] + s.slope[0] * number - first[i0 + i]);
                const float p1 = float(s.offset[1] + s.slope[1] * number - first[i0 + i]);
                start[edge][0][i] = p0, start[edge][1][i] = p1;
                arrivals[edge][i] = MovingEdge<float>(p0, p1).arrival(0);
                per_truncation[edge][i] = usual;
            }
        for (int edge = 0; edge < 2; edge++)
            for (int face : {0, voxels}) { // inside the loop above, this would keep it from being vectorized
                const int i = face - from - i0 - edge;
                if (i >= 0 && i < block) per_truncation[edge][i] = float(no_truncation);
            }
        for (int t = 0; t < taps; t++)
            for (int i = 0; i < block; i++) {
                float part[2][moments];
                for (int edge = 0; edge < 2; edge++) {
                    const MovingEdge<float> moving(start[edge][0][i], start[edge][1][i]);
                    const float next = moving.arrival(float(t + 1));
                    moving.legendre_moments(float(t), arrivals[edge][i], next, moments, per_truncation[edge][i],
                                            part[edge]);
                    arrivals[edge][i] = next;
                }
                for (int m = 0; m < moments; m++) weight[(m * taps + t) * tile_size + i0 + i] = part[1][m] - part[0][m];
            }
    }
}

PALPATE_KERNEL void voxel_weights_of_pixels(const EdgeProjection& s, int moments, int from, int count, int voxels,
                                            int taps, const int32_t* first, float* weight) {
    if (moments == 1) return voxel_weights_of_pixels_by<1>(s, from, count, voxels, taps, first, weight);
    if (moments == 2) return voxel_weights_of_pixels_by<2>(s, from, count, voxels, taps, first, weight);
    voxel_weights_of_pixels_by<3>(s, from, count, voxels, taps, first, weight);
}

PALPATE_KERNEL void pixel_weights_of_voxels(const EdgeProjection& s, int moments, int from, int count, int voxels,
                                            int taps, const int32_t* first, float* weight) {
    if (moments == 1) return pixel_weights_of_voxels_by<1>(s, from, count, voxels, taps, first, weight);
    if (moments == 2) return pixel_weights_of_voxels_by<2>(s, from, count, voxels, taps, first, weight);
    pixel_weights_of_voxels_by<3>(s, from, count, voxels, taps, first, weight);
}

// The part of the source that the elements reach, and the most taps of an element. Empty if begin >= end.
PALPATE_KERNEL void find_extent(const int32_t* __restrict first, const int32_t* __restrict last, int count, int limit,
                                int32_t* out) {
    int32_t taps = 1, begin = limit, end = 0;
    for (int i = 0; i < count; i++) {
        const bool some = last[i] > first[i];
        taps = std::max(taps, last[i] - first[i]);
        begin = std::min(begin, some ? first[i] : limit);
        end = std::max(end, some ? last[i] : 0);
    }
    out[0] = taps, out[1] = begin, out[2] = end;
}

// No tap lies outside the source: taps before or after an element's part have weight 0.
PALPATE_KERNEL void clamp_to_source(const int32_t* __restrict last, int count, int begin, int end,
                                    int32_t* __restrict first, int32_t* __restrict support) {
    for (int i = 0; i < count; i++) {
        first[i] = std::min(std::max(first[i], begin), end);
        support[i] = std::max(0, last[i] - first[i]);
    }
}

namespace {

// Sets all of `out` but its weights from the bounds of each element's part of the source, 0 .. limit.
void set_bounds(const int32_t* last, int count, int limit, int moments, TileWeights& out) {
    int32_t found[3];
    find_extent(out.first, last, count, limit, found);
    out.moments = moments;
    out.count = count;
    out.taps = found[0];
    out.begin = found[1];
    out.end = found[2];
    out.nonempty = out.begin < out.end;
    if (!out.nonempty) return;
    clamp_to_source(last, count, out.begin, out.end - out.taps, out.first, out.support);
    std::fill(out.first + count, out.first + tile_size, out.first[count - 1]);
    std::fill(out.support + count, out.support + tile_size, 0);
    if (out.weight.size() < size_t(moments) * out.taps * tile_size)
        out.weight.resize(size_t(moments) * out.taps * tile_size);
}

void clear_padding(int count, TileWeights& out) {
    const int end = (count + block - 1) / block * block;
    for (int row = 0; row < out.moments * out.taps; row++)
        std::fill(&out.weight[size_t(row) * tile_size + count], &out.weight[size_t(row) * tile_size] + end, 0.0f);
}

} // namespace

void forward_weights(const EdgeProjection& s, int moments, int from, int count, int voxels, TileWeights& out) {
    out.nonempty = std::max(s.offset[0] + s.slope[0] * voxels, s.offset[1] + s.slope[1] * voxels) > from &&
                   std::min(s.offset[0], s.offset[1]) < from + count;
    if (!out.nonempty) return;
    int32_t last[tile_size];
    // The ray to pixel edge a meets the two faces at voxel edges (a - offset) / slope. Times the slope, their
    // distance is the edge's move in pixels.
    const double slope = std::min(s.slope[0], s.slope[1]), per0 = 1 / s.slope[0], per1 = 1 / s.slope[1];
    const double shift = slope * (s.offset[0] * per0 - s.offset[1] * per1), step = slope * (per1 - per0);
    find_voxels(s, least_inset(shift, step, from, count, 2 + 2 * s.slope[0], s.truncation), from, count, voxels,
                out.first, last);
    set_bounds(last, count, voxels, moments, out);
    if (!out.nonempty) return;
    voxel_weights_of_pixels(s, moments, from, count, voxels, out.taps, out.first, out.weight.data());
    clear_padding(count, out);
}

void backprojection_weights(const EdgeProjection& s, int moments, int from, int count, int voxels, int pixels,
                            TileWeights& out) {
    int32_t last[tile_size];
    const double shift = s.offset[1] - s.offset[0], step = s.slope[1] - s.slope[0];
    find_pixels(s, least_inset(shift, step, from, count, 1, s.truncation), from, count, pixels, voxels, out.first,
                last);
    set_bounds(last, count, pixels, moments, out);
    if (!out.nonempty) return;
    pixel_weights_of_voxels(s, moments, from, count, voxels, out.taps, out.first, out.weight.data());
    clear_padding(count, out);
}

// Sets the moments that rows of voxels do not need to 0. row(i, t) is the row of element i at tap t; all rows are in
// begin .. end - 1.
template <class Row> static void clear_moments(const View& view, int begin, int end, Row row, TileWeights& out) {
    int most = 1;
    for (int y = begin; y < end && most < out.moments; y++) most = std::max(most, view.moments_of(y));
    out.moments = most;
    for (int m = 1; m < out.moments; m++)
        for (int t = 0; t < out.taps && view.half_width[m] > 0; t++)
            for (int i = 0; i < out.count; i++)
                if (view.moments_suffice(row(i, t), m)) out.weight[(m * out.taps + t) * tile_size + i] = 0;
}

void drop_moments_of_pixels(const View& view, TileWeights& out) {
    if (out.moments > 1 && out.nonempty)
        clear_moments(view, out.begin, out.end, [&](int i, int t) { return out.first[i] + t; }, out);
}

void drop_moments_of_voxels(const View& view, int from, TileWeights& out) {
    if (out.moments > 1 && out.nonempty)
        clear_moments(view, from, from + out.count, [&](int i, int) { return from + i; }, out);
}

int max_moments_of(const TileWeights* rows, int tiles) {
    int most = 0;
    for (int t = 0; t < tiles; t++)
        if (rows[t].nonempty) most = std::max(most, rows[t].moments);
    return most;
}

} // namespace palpate
