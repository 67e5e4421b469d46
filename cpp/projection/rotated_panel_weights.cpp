// The weights along x on rotated panels, made once a view: all rows use them.
#include "projection/rotated_panel_passes.h"

namespace palpate {
namespace {

// For each voxel, the pixels from out.first on, of which own[i] have any weight.
void by_points(const ScanGeometry& g, const View& v, int slab, std::vector<AxisWeights>& out,
               std::vector<int32_t>& support) {
    out.resize(v.moments);
    for (int m = 0; m < v.moments; m++)
        voxel_weights(g, v, slab / v.subslices, slab % v.subslices * v.moments + m, Axis::x, out[m]);
    AxisWeights& axis = out[0]; // `first` and `taps` are the same for all points
    const size_t n = axis.n;
    support.assign(n, 0);
    for (size_t i = 0; i < n; i++) {
        for (int t = axis.taps; t > 0 && support[i] == 0; t--)
            for (const AxisWeights& w : out)
                if (w.weight[(t - 1) * n + i] != 0) support[i] = t;
        if (i > 0) axis.first[i] = std::max(axis.first[i], axis.first[i - 1]); // voxels outside the panel
    }
}

// Makes blocks with weights of 0, for elements i that read first[i] .. end[i] - 1 of the source, 0 .. size - 1.
void make_room(const std::vector<int32_t>& end, int points, int size, ColumnTable& out) {
    const int count = int(end.size()), blocks = (count + tile_size - 1) / tile_size;
    out.taps.assign(blocks, 0);
    for (int i = 0; i < count; i++) out.taps[i / tile_size] = std::max(out.taps[i / tile_size], end[i] - out.first[i]);
    for (int i = 0; i < count; i++) out.first[i] = std::min(out.first[i], size - out.taps[i / tile_size]);
    out.first.resize(blocks * tile_size, out.first[count - 1]);
    out.max_taps = std::max(1, *std::max_element(out.taps.begin(), out.taps.end()));
    out.weight.assign(size_t(blocks) * points * out.max_taps * tile_size, 0.0f);
}

} // namespace

void backprojection_column_weights(const ScanGeometry& g, const View& v, int slab, ColumnTable& out) {
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
            float* to = out.of(i, v.moments) + (int64_t(m) * out.taps_of(i) + first[i] - out.first[i]) * tile_size;
            for (int t = 0; t < end[i] - first[i]; t++) to[t * tile_size] = voxels[m].weight[size_t(t) * n + i];
        }
}

void forward_column_weights(const ScanGeometry& g, const View& v, int slab, ColumnTable& out) {
    std::vector<AxisWeights> voxels;
    std::vector<int32_t> support;
    by_points(g, v, slab, voxels, support);
    const std::vector<int32_t>& first = voxels[0].first;
    const int n = voxels[0].n;
    std::vector<int32_t> end(v.na);
    out.first.resize(v.na);
    int low = 0, high = 0;
    for (int a = 0; a < v.na; a++) {
        while (low < n && first[low] + support[low] <= a) low++;
        while (high < n && first[high] <= a) high++;
        out.first[a] = std::min(low, high);
        end[a] = high;
    }
    make_room(end, v.moments, n, out);
    for (int a = 0; a < v.na; a++)
        for (int i = out.first[a]; i < end[a]; i++) {
            const int t = a - first[i]; // beyond own[i] if i lies before what the pixel touches
            float* to = out.of(a, v.moments) + int64_t(i - out.first[a]) * tile_size;
            for (int m = 0; m < v.moments && t < support[i]; m++, to += int64_t(out.taps_of(a)) * tile_size)
                *to = voxels[m].weight[size_t(t) * n + i];
        }
}

} // namespace palpate
