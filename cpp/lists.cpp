#include "lists.h"
#include <algorithm>

namespace palpate {
namespace {

// Rows of the fine panel under the tallest measured pixel.
int tallest_pixel(const View& v) {
    const Sparse& measured = v.resampling.measured;
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

Lists::Lists(const Geometry& g) : geometry(g), footprints(g) {
    for (size_t k = 0; k < g.views.size(); k++) {
        if (Layout(g.views[k]).separable) continue;
        listed.push_back(int(k));
        fine_rows.push_back(g.views[k].pose == Pose::tilted ? tallest_pixel(g.views[k]) : 1);
    }
}

void Lists::make(int z) {
    slice = z;
    if (!empty()) footprints.prepare(z);
}

int Lists::rows_apart(size_t i, int z) const {
    const View& view = geometry.views[listed[i]];
    AxisTerms along_y;
    along_y.make(geometry, view, z, view.swapped ? Axis::x : Axis::y);
    return along_y.apart(fine_rows[i]);
}

void Lists::footprint(int view, int y, int x, std::vector<float>& sums, Voxel& out) const {
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

void Lists::measure(const Strip& strip, int x, Paraboloid& data, Scratch& s, Lanes& slope, Lanes& curvature) const {
    s.sums.resize(geometry.pixels(), 0);
    s.voxels.resize(listed.size() * lanes);
    for (size_t k = 0; k < listed.size(); k++) {
        const float *g = data.slope(listed[k]), *c = data.curvature(listed[k]);
        for (int i = 0; i < strip.rows; i++) {
            Voxel& voxel = s.voxels[k * lanes + i];
            footprint(listed[k], strip.y[i], x, s.sums, voxel);
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

void Lists::move(const Strip& strip, const Lanes& change, Paraboloid& data, const Scratch& s) const {
    for (size_t k = 0; k < listed.size(); k++) {
        float* g = data.slope(listed[k]);
        const float* c = data.curvature(listed[k]);
        for (int i = 0; i < strip.rows; i++) {
            const Voxel& voxel = s.voxels[k * lanes + i];
            if (change[i] == 0) continue;
            for (size_t p = 0; p < voxel.pixels.size(); p++)
                g[voxel.pixels[p]] += voxel.weight[p] * c[voxel.pixels[p]] * change[i];
        }
    }
}

} // namespace palpate
