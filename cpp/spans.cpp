#include "spans.h"

namespace palpate {
namespace {

constexpr int block = 8;

PALPATE_INLINE int32_t within(double x, int limit) { return int32_t(std::min(std::max(x, 0.0), double(limit))); }

} // namespace

// first[i] and last[i] of the voxels above pixel from + i.
PALPATE_KERNEL void find_voxels(const Shadow& s, int from, int count, int voxels, int32_t* __restrict first,
                                int32_t* __restrict last) {
    const double per0 = 1 / s.slope[0], per1 = 1 / s.slope[1];
    for (int i = 0; i < count; i++) {
        const double a = from + i, v0 = (a - s.offset[0]) * per0, v1 = (a - s.offset[1]) * per1;
        first[i] = within(std::floor(std::min(v0, v1)), voxels);
        last[i] = within(std::ceil(std::max(v0 + per0, v1 + per1)), voxels);
    }
}

// first[i] and last[i] of the pixels under voxel from + i.
PALPATE_KERNEL void find_pixels(const Shadow& s, int from, int count, int pixels, int32_t* __restrict first,
                                int32_t* __restrict last) {
    for (int i = 0; i < count; i++) {
        const double p0 = s.offset[0] + s.slope[0] * (from + i), p1 = s.offset[1] + s.slope[1] * (from + i);
        first[i] = within(std::floor(std::min(p0, p1)), pixels);
        last[i] = within(std::ceil(std::max(p0 + s.slope[0], p1 + s.slope[1])), pixels);
    }
}

// Weights of a run; positions are counted from each element's first pixel or voxel, so that float holds them.
template <int moments>
PALPATE_INLINE void weigh_voxels_by(const Shadow& s, int from, int count, int taps, const int32_t* __restrict first,
                                    float* __restrict weight) {
    const float slope0 = float(s.slope[0]), slope1 = float(s.slope[1]);
    for (int i0 = 0; i0 < count; i0 += block) {
        float start0[block], start1[block], before[moments][block];
        for (int i = 0; i < block; i++) {
            start0[i] = float(s.offset[0] + s.slope[0] * first[i0 + i] - (from + i0 + i));
            start1[i] = float(s.offset[1] + s.slope[1] * first[i0 + i] - (from + i0 + i));
        }
        for (int i = 0; i < block; i++) {
            float now[moments];
            cover(start0[i], start1[i], moments, now);
            for (int m = 0; m < moments; m++) before[m][i] = now[m];
        }
        for (int t = 1; t <= taps; t++)
            for (int i = 0; i < block; i++) {
                float now[moments];
                cover(start0[i] + float(t) * slope0, start1[i] + float(t) * slope1, moments, now);
                for (int m = 0; m < moments; m++) {
                    weight[(m * taps + t - 1) * run + i0 + i] = now[m] - before[m][i];
                    before[m][i] = now[m];
                }
            }
    }
}

template <int moments>
PALPATE_INLINE void weigh_pixels_by(const Shadow& s, int from, int count, int taps, const int32_t* __restrict first,
                                    float* __restrict weight) {
    const float slope0 = float(s.slope[0]), slope1 = float(s.slope[1]);
    for (int i0 = 0; i0 < count; i0 += block) {
        float start0[block], start1[block];
        for (int i = 0; i < block; i++) {
            start0[i] = float(s.offset[0] + s.slope[0] * (from + i0 + i) - first[i0 + i]);
            start1[i] = float(s.offset[1] + s.slope[1] * (from + i0 + i) - first[i0 + i]);
        }
        for (int t = 0; t < taps; t++)
            for (int i = 0; i < block; i++) {
                float left[moments], right[moments];
                const float p0 = start0[i] - float(t), p1 = start1[i] - float(t);
                cover(p0, p1, moments, left);
                cover(p0 + slope0, p1 + slope1, moments, right);
                for (int m = 0; m < moments; m++) weight[(m * taps + t) * run + i0 + i] = right[m] - left[m];
            }
    }
}

PALPATE_KERNEL void weigh_voxels(const Shadow& s, int moments, int from, int count, int taps, const int32_t* first,
                                 float* weight) {
    if (moments == 1) return weigh_voxels_by<1>(s, from, count, taps, first, weight);
    if (moments == 2) return weigh_voxels_by<2>(s, from, count, taps, first, weight);
    weigh_voxels_by<3>(s, from, count, taps, first, weight);
}

PALPATE_KERNEL void weigh_pixels(const Shadow& s, int moments, int from, int count, int taps, const int32_t* first,
                                 float* weight) {
    if (moments == 1) return weigh_pixels_by<1>(s, from, count, taps, first, weight);
    if (moments == 2) return weigh_pixels_by<2>(s, from, count, taps, first, weight);
    weigh_pixels_by<3>(s, from, count, taps, first, weight);
}

namespace {

// From the bounds of each element's part of the source, 0 .. limit: what Spans says of them.
void bound(const int32_t* last, int count, int limit, int moments, Spans& out) {
    out.moments = moments;
    out.count = count;
    out.taps = 1;
    out.begin = limit;
    out.end = 0;
    for (int i = 0; i < count; i++) {
        if (last[i] <= out.first[i]) continue;
        out.taps = std::max(out.taps, last[i] - out.first[i]);
        out.begin = std::min(out.begin, out.first[i]);
        out.end = std::max(out.end, last[i]);
    }
    out.reached = out.begin < out.end;
    if (!out.reached) return;
    // No tap leaves the source: those before or behind an element's part weigh nothing.
    for (int i = 0; i < count; i++) {
        out.first[i] = std::min(std::max(out.first[i], out.begin), out.end - out.taps);
        out.own[i] = std::max(0, last[i] - out.first[i]);
    }
    for (int i = count; i < run; i++) {
        out.first[i] = out.first[count - 1];
        out.own[i] = 0;
    }
    if (out.weight.size() < size_t(moments) * out.taps * run) out.weight.resize(size_t(moments) * out.taps * run);
}

void clear_beyond(int count, Spans& out) {
    const int end = (count + block - 1) / block * block;
    for (int row = 0; row < out.moments * out.taps; row++)
        std::fill(&out.weight[size_t(row) * run + count], &out.weight[size_t(row) * run] + end, 0.0f);
}

} // namespace

void over_pixels(const Shadow& s, int moments, int from, int count, int voxels, Spans& out) {
    int32_t last[run];
    find_voxels(s, from, count, voxels, out.first, last);
    bound(last, count, voxels, moments, out);
    if (!out.reached) return;
    weigh_voxels(s, moments, from, count, out.taps, out.first, out.weight.data());
    clear_beyond(count, out);
}

void under_voxels(const Shadow& s, int moments, int from, int count, int pixels, Spans& out) {
    int32_t last[run];
    find_pixels(s, from, count, pixels, out.first, last);
    bound(last, count, pixels, moments, out);
    if (!out.reached) return;
    weigh_pixels(s, moments, from, count, out.taps, out.first, out.weight.data());
    clear_beyond(count, out);
}

void calm_pixels(const View& view, Spans& out) {
    if (out.moments == 1 || !out.reached) return;
    bool all = true;
    for (int row = out.begin; row < out.end; row++) all = all && view.calm(row);
    if (all) out.moments = 1;
    if (all || view.band == 0) return;
    for (int m = 1; m < out.moments; m++)
        for (int t = 0; t < out.taps; t++)
            for (int i = 0; i < out.count; i++)
                if (view.calm(out.first[i] + t)) out.weight[(m * out.taps + t) * run + i] = 0;
}

void calm_voxels(const View& view, int from, Spans& out) {
    if (out.moments == 1 || !out.reached) return;
    bool all = true;
    for (int i = 0; i < out.count; i++) all = all && view.calm(from + i);
    if (all) out.moments = 1;
    if (all || view.band == 0) return;
    for (int m = 1; m < out.moments; m++)
        for (int t = 0; t < out.taps; t++)
            for (int i = 0; i < out.count; i++)
                if (view.calm(from + i)) out.weight[(m * out.taps + t) * run + i] = 0;
}

} // namespace palpate
