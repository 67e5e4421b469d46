// The weights along x of turned panels, made once a view: they serve all rows.
#include "turned_passes.h"

namespace palpate {
namespace {

// Per voxel, the pixels from out.first on; `own` of them have any weight.
void by_points(const Geometry& g, const View& v, int slab, std::vector<AxisWeights>& out, std::vector<int32_t>& own) {
    out.resize(v.moments);
    for (int m = 0; m < v.moments; m++) by_voxel(g, v, slab / v.subs, slab % v.subs * v.moments + m, Axis::x, out[m]);
    AxisWeights& axis = out[0]; // first and taps are those of all points
    const size_t n = axis.n;
    own.assign(n, 0);
    for (size_t i = 0; i < n; i++) {
        for (int t = axis.taps; t > 0 && own[i] == 0; t--)
            for (const AxisWeights& w : out)
                if (w.weight[(t - 1) * n + i] != 0) own[i] = t;
        if (i > 0) axis.first[i] = std::max(axis.first[i], axis.first[i - 1]); // beyond the panel
    }
}

// Blocks of weights 0, for elements of which i touches those of the source, 0 .. size, from first[i] to end[i].
void make_room(const std::vector<int32_t>& end, int points, int size, ColumnTable& out) {
    const int count = int(end.size()), blocks = (count + run - 1) / run;
    out.taps.assign(blocks, 0);
    for (int i = 0; i < count; i++) out.taps[i / run] = std::max(out.taps[i / run], end[i] - out.first[i]);
    for (int i = 0; i < count; i++) out.first[i] = std::min(out.first[i], size - out.taps[i / run]);
    out.first.resize(blocks * run, out.first[count - 1]);
    out.most = std::max(1, *std::max_element(out.taps.begin(), out.taps.end()));
    out.weight.assign(size_t(blocks) * points * out.most * run, 0.0f);
}

} // namespace

void under_columns(const Geometry& g, const View& v, int slab, ColumnTable& out) {
    std::vector<AxisWeights> voxels;
    std::vector<int32_t> end;
    by_points(g, v, slab, voxels, end);
    const int n = voxels[0].n;
    const std::vector<int32_t> first = voxels[0].first;
    out.first = first;
    for (int i = 0; i < n; i++) end[i] += first[i];
    make_room(end, v.moments, v.na, out);
    for (int i = 0; i < n; i++)
        for (int m = 0; m < v.moments; m++) {
            float* to = out.of(i, v.moments) + (int64_t(m) * out.taps_of(i) + first[i] - out.first[i]) * run;
            for (int t = 0; t < end[i] - first[i]; t++) to[t * run] = voxels[m].weight[size_t(t) * n + i];
        }
}

void over_columns(const Geometry& g, const View& v, int slab, ColumnTable& out) {
    std::vector<AxisWeights> voxels;
    std::vector<int32_t> own;
    by_points(g, v, slab, voxels, own);
    const std::vector<int32_t>& first = voxels[0].first;
    const int n = voxels[0].n;
    std::vector<int32_t> end(v.na);
    out.first.resize(v.na);
    int low = 0, high = 0;
    for (int a = 0; a < v.na; a++) {
        while (low < n && first[low] + own[low] <= a) low++;
        while (high < n && first[high] <= a) high++;
        out.first[a] = std::min(low, high);
        end[a] = high;
    }
    make_room(end, v.moments, n, out);
    for (int a = 0; a < v.na; a++)
        for (int i = out.first[a]; i < end[a]; i++) {
            const int t = a - first[i]; // beyond own[i] if i lies before what the pixel touches
            float* to = out.of(a, v.moments) + int64_t(i - out.first[a]) * run;
            for (int m = 0; m < v.moments && t < own[i]; m++, to += int64_t(out.taps_of(a)) * run)
                *to = voxels[m].weight[size_t(t) * n + i];
        }
}

} // namespace palpate
