// The separable projector. Two passes of short 1-D sums resample each sub-slice onto the panel: A_k = path * sum of
// products W^y x W^x. Back projection uses the same two passes with the transposed weights.
//
// The result is made in tiles that stay in the cache while all that adds to them is read (forward_tiles.cpp,
// backprojection_tiles.cpp). This file adds what the tiles do not do: the resampling of oblique panels, and rotated
// panels (rotated_panel.cpp).
#include "projection/projector.h"
#include "base/thread_pool.h"
#include "projection/backprojection_tiles.h"
#include "projection/forward_tiles.h"
#include "projection/rotated_panel.h"
#include <algorithm>

namespace palpate {

namespace {

// The views with separable footprints: all but those with rotated panels.
void project_separable(const ScanGeometry& g, const float* f, bool add, float* p) {
    const int views = int(g.views.size());
    std::vector<std::vector<float>> fine(views); // images of oblique panels, to be resampled
    std::vector<float*> images(views, nullptr);
    for (int k = 0; k < views; k++) {
        const View& v = g.views[k];
        if (v.orientation == PanelOrientation::oblique) fine[k].resize(size_t(v.na) * v.nb);
        if (v.orientation != PanelOrientation::rotated)
            images[k] = v.orientation == PanelOrientation::oblique ? fine[k].data() : p + k * g.pixels();
    }
    project_tiles(g, f, images, add);
    std::vector<float> resampled;
    for (int k = 0; k < views; k++) {
        if (fine[k].empty()) continue;
        float* measured = p + k * g.pixels();
        resampled.resize(g.pixels());
        apply(g.views[k].resampling.measured, fine[k].data(), resampled.data());
        parallel(g.rows, [&](int64_t begin, int64_t end, int) {
            std::vector<float> path(g.columns);
            for (int64_t r = begin; r < end; r++) {
                g.views[k].path(r * g.columns, 1, g.columns, path.data());
                for (int64_t c = 0, i = r * g.columns; c < g.columns; c++, i++)
                    measured[i] = (add ? measured[i] : 0) + resampled[i] * path[c];
            }
        });
    }
}

// From the measured pixels of an oblique panel, scaled by the rays' path, to its fine parallel image.
void to_fine(const View& v, int64_t pixels, const float* p, std::vector<float>& image) {
    std::vector<float> scaled(pixels);
    for (int64_t row = 0; row < pixels; row += v.path.columns) v.path(row, 1, v.path.columns, &scaled[row]);
    for (int64_t i = 0; i < pixels; i++) scaled[i] *= p[i];
    image.resize(size_t(v.na) * v.nb);
    apply(v.resampling.fine, scaled.data(), image.data());
}

// Overwrites f with the back projection of those views.
void backproject_separable(const ScanGeometry& g, const float* p, float* f) {
    const int views = int(g.views.size());
    std::vector<std::vector<float>> fine(views);
    std::vector<const float*> images(views, nullptr);
    parallel_tasks(views, [&](int64_t k, int) {
        const PanelOrientation orientation = g.views[k].orientation;
        if (orientation == PanelOrientation::oblique) to_fine(g.views[k], g.pixels(), p + k * g.pixels(), fine[k]);
        if (orientation != PanelOrientation::rotated)
            images[k] = orientation == PanelOrientation::oblique ? fine[k].data() : p + k * g.pixels();
    });
    backproject_tiles(g, images, f);
}

// Exchanges x and y in each slice, for views that have them exchanged.
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

bool any_swapped(const ScanGeometry& g) {
    return std::any_of(g.views.begin(), g.views.end(), [](const View& v) { return v.swapped; });
}

} // namespace

void project(const ScanGeometry& g, const float* f, float* p, bool add) {
    const Grid& grid = g.grid;
    project_separable(g, f, add, p);
    std::vector<float> image, exchanged;
    if (any_swapped(g)) {
        exchanged.resize(grid.nz * grid.slice());
        exchange(f, grid.nz, grid.ny, grid.nx, false, exchanged.data());
    }
    for (size_t k = 0; k < g.views.size(); k++) {
        const View& v = g.views[k];
        if (v.orientation != PanelOrientation::rotated) continue;
        float* measured = p + k * g.pixels();
        image.resize(size_t(v.nb) * v.na);
        project_rotated(g, v, v.swapped ? exchanged.data() : f, image.data());
        parallel(v.nb, [&](int64_t begin, int64_t end, int) {
            std::vector<float> path(v.na);
            for (int64_t b = begin; b < end; b++) {
                const int64_t first = v.start + b * v.step_b;
                v.path(first, v.step_a, v.na, path.data());
                for (int64_t a = 0; a < v.na; a++) {
                    float& pixel = measured[first + a * v.step_a];
                    pixel = (add ? pixel : 0) + image[b * v.na + a] * path[a];
                }
            }
        });
    }
}

void backproject(const ScanGeometry& g, const float* p, float* f) {
    const Grid& grid = g.grid;
    backproject_separable(g, p, f);
    std::vector<float> image, exchanged(any_swapped(g) ? grid.nz * grid.slice() : 0, 0.0f);
    for (size_t k = 0; k < g.views.size(); k++) {
        const View& v = g.views[k];
        if (v.orientation != PanelOrientation::rotated) continue;
        image.resize(size_t(v.nb) * v.na);
        parallel(v.nb, [&](int64_t begin, int64_t end, int) {
            std::vector<float> path(v.na);
            for (int64_t b = begin; b < end; b++) {
                const int64_t first = v.start + b * v.step_b;
                v.path(first, v.step_a, v.na, path.data());
                for (int64_t a = 0; a < v.na; a++)
                    image[b * v.na + a] = p[k * g.pixels() + first + a * v.step_a] * path[a];
            }
        });
        backproject_rotated(g, v, image.data(), v.swapped ? exchanged.data() : f);
    }
    if (!exchanged.empty()) exchange(exchanged.data(), grid.nz, grid.nx, grid.ny, true, f);
}

} // namespace palpate
