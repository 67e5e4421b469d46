#include "spans.h"

namespace palpate {
namespace {

constexpr int block = 16;

PALPATE_INLINE int32_t within(double x, int limit) { return int32_t(std::min(std::max(x, 0.0), double(limit))); }

// How far into a pixel an edge may come, in pixels, while what it cuts off is still trimmed away; `move` is how far it
// moves over the thickness. It cuts off d² / (2 move) where it comes in while it moves, d - move / 2 where it is
// faster.
double inset(double move, double trim) {
    return move > 2 * trim ? std::min(1.0, std::sqrt(2 * trim * move)) : trim + 0.5 * move;
}

// The least of that which elements `from` to `from` + `count` of one axis allow, whose edges move by `move` + i *
// `step`, and edges over `over` more elements too.
double least_inset(double move, double step, int from, int count, double over, double trim) {
    const double first = move + step * (from - over), last = move + step * (from + count + over);
    const double least = (first < 0) != (last < 0) ? 0 : std::min(std::fabs(first), std::fabs(last));
    return 0.999 * inset(least, trim);
}

} // namespace

// first[i] and last[i] of the voxels above pixel from + i.
PALPATE_KERNEL void find_voxels(const Shadow& s, double inset, int from, int count, int voxels,
                                int32_t* __restrict first, int32_t* __restrict last) {
    const double per0 = 1 / s.slope[0], per1 = 1 / s.slope[1], in = inset * std::min(per0, per1);
    for (int i = 0; i < count; i++) {
        const double a = from + i, v0 = (a - s.offset[0]) * per0, v1 = (a - s.offset[1]) * per1;
        const double low = std::min(v0, v1), high = std::max(v0 + per0, v1 + per1);
        first[i] = low < voxels ? within(std::floor(low + in), voxels - 1) : voxels;
        last[i] = high > 0 ? std::max(within(std::ceil(high - in), voxels), 1) : 0;
    }
}

// first[i] and last[i] of the pixels under voxel from + i.
PALPATE_KERNEL void find_pixels(const Shadow& s, double inset, int from, int count, int pixels, int voxels,
                                int32_t* __restrict first, int32_t* __restrict last) {
    for (int i = 0; i < count; i++) {
        const double before = from + i == 0 ? 0 : inset, behind = from + i + 1 == voxels ? 0 : inset;
        const double p0 = s.offset[0] + s.slope[0] * (from + i), p1 = s.offset[1] + s.slope[1] * (from + i);
        first[i] = within(std::floor(std::min(p0, p1) + before), pixels);
        last[i] = within(std::ceil(std::max(p0 + s.slope[0], p1 + s.slope[1]) - behind), pixels);
    }
}

// Weights of a run; positions are counted from each element's first pixel or voxel, so that float holds them. The
// volume's own edges are not trimmed: on their other side there is no voxel that could get what is taken off.
template <int moments>
PALPATE_INLINE void weigh_voxels_by(const Shadow& s, int from, int count, int voxels, int taps,
                                    const int32_t* __restrict first, float* __restrict weight) {
    const float slope0 = float(s.slope[0]), slope1 = float(s.slope[1]);
    const float per_trim = float(per(s.trim)), all = float(untrimmed);
    for (int i0 = 0; i0 < count; i0 += block) {
        float start0[block], start1[block], before[moments][block];
        for (int i = 0; i < block; i++) {
            start0[i] = float(s.offset[0] + s.slope[0] * first[i0 + i] - (from + i0 + i));
            start1[i] = float(s.offset[1] + s.slope[1] * first[i0 + i] - (from + i0 + i));
        }
        for (int i = 0; i < block; i++) {
            float now[moments];
            cover(start0[i], start1[i], moments, first[i0 + i] == 0 ? all : per_trim, now);
            for (int m = 0; m < moments; m++) before[m][i] = now[m];
        }
        for (int t = 1; t <= taps; t++)
            for (int i = 0; i < block; i++) {
                float now[moments];
                cover(start0[i] + float(t) * slope0, start1[i] + float(t) * slope1, moments,
                      first[i0 + i] + t == voxels ? all : per_trim, now);
                for (int m = 0; m < moments; m++) {
                    weight[(m * taps + t - 1) * run + i0 + i] = now[m] - before[m][i];
                    before[m][i] = now[m];
                }
            }
    }
}

template <int moments>
PALPATE_INLINE void weigh_pixels_by(const Shadow& s, int from, int count, int voxels, int taps,
                                    const int32_t* __restrict first, float* __restrict weight) {
    for (int i0 = 0; i0 < count; i0 += block) {
        const float usual = float(per(s.trim));
        float start[2][2][block], time[2][block], per_trim[2][block]; // of either edge
        for (int edge = 0; edge < 2; edge++)
            for (int i = 0; i < block; i++) {
                const int number = from + i0 + i + edge;
                const float p0 = float(s.offset[0] + s.slope[0] * number - first[i0 + i]);
                const float p1 = float(s.offset[1] + s.slope[1] * number - first[i0 + i]);
                start[edge][0][i] = p0, start[edge][1][i] = p1;
                time[edge][i] = Crossing<float>(p0, p1).reaches(0);
                per_trim[edge][i] = usual;
            }
        for (int edge = 0; edge < 2; edge++)
            for (int face : {0, voxels}) { // in the loop above it would keep that one from being vectors
                const int i = face - from - i0 - edge;
                if (i >= 0 && i < block) per_trim[edge][i] = float(untrimmed);
            }
        for (int t = 0; t < taps; t++)
            for (int i = 0; i < block; i++) {
                float part[2][moments];
                for (int edge = 0; edge < 2; edge++) {
                    const Crossing<float> sweep(start[edge][0][i], start[edge][1][i]);
                    const float next = sweep.reaches(float(t + 1));
                    sweep.cover(float(t), time[edge][i], next, moments, per_trim[edge][i], part[edge]);
                    time[edge][i] = next;
                }
                for (int m = 0; m < moments; m++) weight[(m * taps + t) * run + i0 + i] = part[1][m] - part[0][m];
            }
    }
}

PALPATE_KERNEL void weigh_voxels(const Shadow& s, int moments, int from, int count, int voxels, int taps,
                                 const int32_t* first, float* weight) {
    if (moments == 1) return weigh_voxels_by<1>(s, from, count, voxels, taps, first, weight);
    if (moments == 2) return weigh_voxels_by<2>(s, from, count, voxels, taps, first, weight);
    weigh_voxels_by<3>(s, from, count, voxels, taps, first, weight);
}

PALPATE_KERNEL void weigh_pixels(const Shadow& s, int moments, int from, int count, int voxels, int taps,
                                 const int32_t* first, float* weight) {
    if (moments == 1) return weigh_pixels_by<1>(s, from, count, voxels, taps, first, weight);
    if (moments == 2) return weigh_pixels_by<2>(s, from, count, voxels, taps, first, weight);
    weigh_pixels_by<3>(s, from, count, voxels, taps, first, weight);
}

// What of the source the elements reach: its beginning and end, and the most that one takes. Nothing: begin >= end.
PALPATE_KERNEL void reach(const int32_t* __restrict first, const int32_t* __restrict last, int count, int limit,
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

// No tap leaves the source: those before or behind an element's part weigh nothing.
PALPATE_KERNEL void keep_inside(const int32_t* __restrict last, int count, int begin, int end,
                                int32_t* __restrict first, int32_t* __restrict own) {
    for (int i = 0; i < count; i++) {
        first[i] = std::min(std::max(first[i], begin), end);
        own[i] = std::max(0, last[i] - first[i]);
    }
}

namespace {

// From the bounds of each element's part of the source, 0 .. limit: what Spans says of them.
void bound(const int32_t* last, int count, int limit, int moments, Spans& out) {
    int32_t found[3];
    reach(out.first, last, count, limit, found);
    out.moments = moments;
    out.count = count;
    out.taps = found[0];
    out.begin = found[1];
    out.end = found[2];
    out.reached = out.begin < out.end;
    if (!out.reached) return;
    keep_inside(last, count, out.begin, out.end - out.taps, out.first, out.own);
    std::fill(out.first + count, out.first + run, out.first[count - 1]);
    std::fill(out.own + count, out.own + run, 0);
    if (out.weight.size() < size_t(moments) * out.taps * run) out.weight.resize(size_t(moments) * out.taps * run);
}

void clear_beyond(int count, Spans& out) {
    const int end = (count + block - 1) / block * block;
    for (int row = 0; row < out.moments * out.taps; row++)
        std::fill(&out.weight[size_t(row) * run + count], &out.weight[size_t(row) * run] + end, 0.0f);
}

} // namespace

void over_pixels(const Shadow& s, int moments, int from, int count, int voxels, Spans& out) {
    out.reached = std::max(s.offset[0] + s.slope[0] * voxels, s.offset[1] + s.slope[1] * voxels) > from &&
                  std::min(s.offset[0], s.offset[1]) < from + count;
    if (!out.reached) return;
    int32_t last[run];
    // Pixel edge a lies over voxel edge (a - offset) / slope, different at the two faces: seen from the voxels, it
    // moves by slope times that.
    const double slope = std::min(s.slope[0], s.slope[1]), per0 = 1 / s.slope[0], per1 = 1 / s.slope[1];
    const double move = slope * (s.offset[0] * per0 - s.offset[1] * per1), step = slope * (per1 - per0);
    find_voxels(s, least_inset(move, step, from, count, 2 + 2 * s.slope[0], s.trim), from, count, voxels, out.first,
                last);
    bound(last, count, voxels, moments, out);
    if (!out.reached) return;
    weigh_voxels(s, moments, from, count, voxels, out.taps, out.first, out.weight.data());
    clear_beyond(count, out);
}

void under_voxels(const Shadow& s, int moments, int from, int count, int voxels, int pixels, Spans& out) {
    int32_t last[run];
    const double move = s.offset[1] - s.offset[0], step = s.slope[1] - s.slope[0];
    find_pixels(s, least_inset(move, step, from, count, 1, s.trim), from, count, pixels, voxels, out.first, last);
    bound(last, count, pixels, moments, out);
    if (!out.reached) return;
    weigh_pixels(s, moments, from, count, voxels, out.taps, out.first, out.weight.data());
    clear_beyond(count, out);
}

// Clears the moments that the voxels' rows need not, row(i, t) that of element i at tap t; the rows of all of them are
// begin .. end - 1.
template <class Row> static void calm(const View& view, int begin, int end, Row row, Spans& out) {
    int most = 1;
    for (int y = begin; y < end && most < out.moments; y++) most = std::max(most, view.moments_of(y));
    out.moments = most;
    for (int m = 1; m < out.moments; m++)
        for (int t = 0; t < out.taps && view.band[m] > 0; t++)
            for (int i = 0; i < out.count; i++)
                if (view.calm(row(i, t), m)) out.weight[(m * out.taps + t) * run + i] = 0;
}

void calm_pixels(const View& view, Spans& out) {
    if (out.moments > 1 && out.reached)
        calm(view, out.begin, out.end, [&](int i, int t) { return out.first[i] + t; }, out);
}

void calm_voxels(const View& view, int from, Spans& out) {
    if (out.moments > 1 && out.reached) calm(view, from, from + out.count, [&](int i, int) { return from + i; }, out);
}

int most_moments_of(const Spans* rows, int tiles) {
    int most = 0;
    for (int t = 0; t < tiles; t++)
        if (rows[t].reached) most = std::max(most, rows[t].moments);
    return most;
}

} // namespace palpate
