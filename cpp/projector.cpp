// The separable projector: each slice is resampled onto the panel by two passes of short 1-D sums (design: A_k = path *
// sum over slices of W^y x W^x). The first pass runs along whole rows, so it vectorises without a shuffle.
#include "projector.h"
#include "parallel.h"
#include "taps.h"
#include "turned.h"
#include "weights.h"
#include <algorithm>

namespace palpate {

namespace {

// Weights of every sub-slice of one view: a few MB, made anew for each view rather than kept for all.
struct Tables {
    std::vector<AxisWeights> x, y;
    int padding = 1;

    Tables(const Geometry& g, const View& v, bool per_pixel) : x(size_t(g.grid.nz) * v.subs), y(x.size()) {
        parallel(int64_t(x.size()), [&](int64_t begin, int64_t end, int) {
            AxisWeights voxels;
            for (int64_t i = begin; i < end; i++)
                for (Axis axis : {Axis::x, Axis::y}) {
                    AxisWeights& out = axis == Axis::x ? x[i] : y[i];
                    by_voxel(g, v, int(i / v.subs), int(i % v.subs), axis, per_pixel ? voxels : out);
                    if (per_pixel) by_pixel(voxels, axis == Axis::x ? v.na : v.nb, out);
                }
        });
        for (auto* axis : {&x, &y})
            for (auto& weights : *axis) padding = std::max(padding, weights.taps);
    }
};

void project_parallel(const Geometry& g, const View& v, const float* f, float* image) {
    const Grid grid = g.seen_by(v);
    const Tables tables(g, v, true);
    std::fill_n(image, int64_t(v.nb) * v.na, 0.0f);
    parallel(v.nb, [&](int64_t begin, int64_t end, int) {
        std::vector<float> row(grid.nx + tables.padding, 0.0f);
        for (size_t i = 0; i < tables.x.size(); i++) {
            const AxisWeights &wx = tables.x[i], &wy = tables.y[i];
            const float* slice = f + int64_t(i / v.subs) * grid.slice();
            for (int64_t b = begin; b < end; b++) {
                bool any = false;
                for (int t = 0; t < wy.taps; t++) {
                    const float w = wy.weight[size_t(t) * v.nb + b];
                    if (w == 0) continue;
                    if (!any) std::fill_n(row.begin(), grid.nx, 0.0f);
                    any = true;
                    add_row(grid.nx, w, slice + int64_t(wy.first[b] + t) * grid.nx, row.data());
                }
                if (any) add_taps(v.na, wx.taps, wx.first.data(), wx.weight.data(), row.data(), &image[b * v.na]);
            }
        }
    });
}

void backproject_parallel(const Geometry& g, const View& v, const float* image, float* f) {
    const Grid grid = g.seen_by(v);
    const Tables tables(g, v, false);
    parallel(grid.nz, [&](int64_t begin, int64_t end, int) {
        std::vector<float> pixels(v.na + tables.padding, 0.0f), rows(size_t(v.nb) * grid.nx);
        for (int64_t i = begin * v.subs; i < end * v.subs; i++) {
            const AxisWeights &wx = tables.x[i], &wy = tables.y[i];
            float* slice = f + (i / v.subs) * grid.slice();
            int made = 0; // rows of the image are resampled in order, each when the first voxel row needs it
            for (int y = 0; y < grid.ny; y++)
                for (int t = 0; t < wy.taps; t++) {
                    const float w = wy.weight[size_t(t) * grid.ny + y];
                    if (w == 0) continue;
                    const int b = wy.first[y] + t;
                    for (made = std::max(made, wy.first[y]); made <= b; made++) {
                        std::copy_n(&image[size_t(made) * v.na], v.na, pixels.begin());
                        std::fill_n(&rows[size_t(made) * grid.nx], grid.nx, 0.0f);
                        add_taps(grid.nx, wx.taps, wx.first.data(), wx.weight.data(), pixels.data(),
                                 &rows[size_t(made) * grid.nx]);
                    }
                    add_row(grid.nx, w, &rows[size_t(b) * grid.nx], slice + int64_t(y) * grid.nx);
                }
        }
    });
}

// Each slice with x and y exchanged, for views that see it so.
void exchange(const float* in, int nz, int ny, int nx, bool add, float* out) {
    parallel(nz, [&](int64_t begin, int64_t end, int) {
        for (int64_t z = begin; z < end; z++)
            for (int y = 0; y < ny; y++)
                for (int x = 0; x < nx; x++) {
                    float& to = out[(z * nx + x) * ny + y];
                    to = (add ? to : 0) + in[(z * ny + y) * nx + x];
                }
    });
}

bool any_swapped(const Geometry& g) {
    return std::any_of(g.views.begin(), g.views.end(), [](const View& v) { return v.swapped; });
}

} // namespace

void project(const Geometry& g, const float* f, float* p) {
    const Grid& grid = g.grid;
    std::vector<float> image, exchanged;
    if (any_swapped(g)) {
        exchanged.resize(grid.nz * grid.slice());
        exchange(f, grid.nz, grid.ny, grid.nx, false, exchanged.data());
    }
    for (size_t k = 0; k < g.views.size(); k++, p += g.pixels()) {
        const View& v = g.views[k];
        image.resize(size_t(v.nb) * v.na);
        const float* seen = v.swapped ? exchanged.data() : f;
        v.pose == Pose::turned ? project_turned(g, v, seen, image.data()) : project_parallel(g, v, seen, image.data());
        if (v.pose == Pose::tilted) {
            apply(v.resampling.measured, image.data(), p);
        } else {
            for (int64_t b = 0; b < v.nb; b++)
                for (int64_t a = 0; a < v.na; a++) p[v.start + b * v.step_b + a * v.step_a] = image[b * v.na + a];
        }
        for (int64_t i = 0; i < g.pixels(); i++) p[i] *= v.path[i];
    }
}

void backproject(const Geometry& g, const float* p, float* f) {
    const Grid& grid = g.grid;
    std::fill_n(f, grid.nz * grid.slice(), 0.0f);
    std::vector<float> image, scaled(g.pixels()), exchanged(any_swapped(g) ? grid.nz * grid.slice() : 0, 0.0f);
    for (size_t k = 0; k < g.views.size(); k++, p += g.pixels()) {
        const View& v = g.views[k];
        image.resize(size_t(v.nb) * v.na);
        for (int64_t i = 0; i < g.pixels(); i++) scaled[i] = p[i] * v.path[i];
        if (v.pose == Pose::tilted) {
            apply(v.resampling.fine, scaled.data(), image.data());
        } else {
            for (int64_t b = 0; b < v.nb; b++)
                for (int64_t a = 0; a < v.na; a++) image[b * v.na + a] = scaled[v.start + b * v.step_b + a * v.step_a];
        }
        float* seen = v.swapped ? exchanged.data() : f;
        v.pose == Pose::turned ? backproject_turned(g, v, image.data(), seen)
                               : backproject_parallel(g, v, image.data(), seen);
    }
    if (!exchanged.empty()) exchange(exchanged.data(), grid.nz, grid.nx, grid.ny, true, f);
}

} // namespace palpate
