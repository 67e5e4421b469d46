#include "icd/sparse_footprints.h"
#include "icd/axis_footprint.h"
#include "icd/view_layout.h"
#include <algorithm>

namespace palpate {
namespace {

// Rows of the fine panel under the tallest measured pixel.
int tallest_pixel(const View& v) {
    const SparseRows& measured = v.resampling.measured;
    int most = 1;
    for (size_t i = 0; i + 1 < measured.offset.size(); i++) {
        int low = INT32_MAX, high = -1;
        for (int64_t e = measured.offset[i]; e < measured.offset[i + 1]; e++) {
            low = std::min(low, measured.index[e] / v.na);
            high = std::max(high, measured.index[e] / v.na);
        }
        if (high >= 0) most = std::max(most, high - low + 1);
    }
    return most;
}

} // namespace

SparseFootprints::SparseFootprints(const ScanGeometry& g) : geometry(g), footprints(g) {
    for (size_t k = 0; k < g.views.size(); k++) {
        if (ViewLayout(g.views[k]).separable) continue;
        listed.push_back(int(k));
        fine_rows.push_back(g.views[k].orientation == PanelOrientation::oblique ? tallest_pixel(g.views[k]) : 1);
    }
}

void SparseFootprints::make(int z) {
    slice = z;
    if (!empty()) footprints.prepare(z);
}

int SparseFootprints::independent_step(size_t i, int z) const {
    const View& view = geometry.views[listed[i]];
    AxisFootprint along_y;
    along_y.make(geometry, view, z, view.swapped ? Axis::x : Axis::y);
    return along_y.independent_step(fine_rows[i] - 1);
}

void SparseFootprints::footprint(int view, int y, int x, std::vector<float>& sums, Voxel& out) const {
    out.pixels.clear();
    footprints.visit(view, y, x, [&](int64_t pixel, float weight) {
        if (weight == 0) return;
        if (sums[pixel] == 0) out.pixels.push_back(pixel);
        sums[pixel] += weight;
    });
    out.weight.resize(out.pixels.size());
    for (size_t i = 0; i < out.pixels.size(); i++) {
        out.weight[i] = sums[out.pixels[i]];
        sums[out.pixels[i]] = 0;
    }
}

void SparseFootprints::add_derivatives(const RowGroup& group, int x, SurrogateImages& data, Scratch& s, f32x8& slope,
                                       f32x8& curvature) const {
    s.sums.resize(geometry.pixels(), 0);
    s.voxels.resize(listed.size() * lanes);
    for (size_t k = 0; k < listed.size(); k++) {
        const float *g = data.slope(listed[k]), *c = data.curvature(listed[k]);
        for (int i = 0; i < group.rows; i++) {
            Voxel& voxel = s.voxels[k * lanes + i];
            footprint(listed[k], group.y[i], x, s.sums, voxel);
            float first = 0, second = 0;
            for (size_t p = 0; p < voxel.pixels.size(); p++) {
                const float a = voxel.weight[p];
                first += a * g[voxel.pixels[p]];
                second += a * a * c[voxel.pixels[p]];
            }
            slope[i] += first;
            curvature[i] += second;
        }
    }
}

void SparseFootprints::apply_change(const RowGroup& group, const f32x8& change, SurrogateImages& data,
                                    const Scratch& s) const {
    for (size_t k = 0; k < listed.size(); k++) {
        float* g = data.slope(listed[k]);
        const float* c = data.curvature(listed[k]);
        for (int i = 0; i < group.rows; i++) {
            const Voxel& voxel = s.voxels[k * lanes + i];
            if (change[i] == 0) continue;
            for (size_t p = 0; p < voxel.pixels.size(); p++)
                g[voxel.pixels[p]] += voxel.weight[p] * c[voxel.pixels[p]] * change[i];
        }
    }
}

} // namespace palpate
