#include "descent.h"
#include "boxes.h"
#include "parallel.h"
#include <algorithm>

namespace palpate {

Paraboloid::Paraboloid(const Geometry& geometry, const float* slope, const float* curvature)
    : images(geometry.views.size()) {
    parallel(int64_t(images.size()), [&](int64_t begin, int64_t end, int) {
        for (int64_t k = begin; k < end; k++) {
            const View& v = geometry.views[k];
            const float *h1 = slope + k * geometry.pixels(), *h2 = curvature + k * geometry.pixels();
            const int rows = v.resampled ? v.panel.rows : v.nb, columns = v.resampled ? v.panel.columns : v.na;
            const int64_t start = v.resampled ? 0 : v.start, down = v.resampled ? columns : v.step_b,
                          right = v.resampled ? 1 : v.step_a;
            Image& image = images[k];
            image.stride = columns + column_padding;
            image.slope.assign(rows * image.stride + column_padding, 0);
            image.curvature.assign(image.slope.size(), 0);
            for (int64_t b = 0; b < rows; b++)
                for (int64_t a = 0; a < columns; a++) {
                    const int64_t pixel = start + b * down + a * right;
                    image.slope[b * image.stride + a] = h1[pixel] * v.path[pixel];
                    image.curvature[b * image.stride + a] = h2[pixel] * v.path[pixel] * v.path[pixel];
                }
        }
    });
}

namespace {

// A voxel's slope and curvature in one view.
PALPATE_KERNEL void gather(const Box& box, const float* slope, const float* curvature, int64_t stride, Lanes* sums) {
    const int64_t start = box.row * stride + box.column;
    const float* weight = box.weight;
    Lanes first = sums[0], second = sums[1];
    for (int v = 0; v < box.height; v++)
        for (int u = 0; u < box.width; u += lanes, weight += lanes) {
            Lanes a, g, c;
            load(a, weight);
            load(g, slope + start + v * stride + u);
            load(c, curvature + start + v * stride + u);
            first += a * g;
            second += a * a * c;
        }
    sums[0] = first;
    sums[1] = second;
}

// slope += a · curvature · change of the voxel.
PALPATE_KERNEL void spread(const Box& box, float change, const float* curvature, int64_t stride, float* slope) {
    const int64_t start = box.row * stride + box.column;
    const float* weight = box.weight;
    for (int v = 0; v < box.height; v++)
        for (int u = 0; u < box.width; u += lanes, weight += lanes) {
            Lanes a, g, c;
            load(a, weight);
            load(g, slope + start + v * stride + u);
            load(c, curvature + start + v * stride + u);
            g += a * c * change;
            store(slope + start + v * stride + u, g);
        }
}

// What one thread needs, made once a sweep.
struct Scratch {
    std::vector<float> gradient, curvature; // of the prior, along a row
    std::vector<float> boxes, pixels;
    std::vector<Box> box;
};

// Footprints of a slice in all views.
struct Slice {
    const Geometry& geometry;
    std::vector<SliceFootprints> views;
    int64_t capacity = 0; // of the boxes of one voxel in all views
    int stride = 1;

    explicit Slice(const Geometry& g) : geometry(g), views(g.views.size()) {}

    void make(int z) {
        std::vector<int64_t> needs(views.size());
        std::vector<int> apart(views.size());
        parallel(int64_t(views.size()), [&](int64_t begin, int64_t end, int) {
            for (int64_t k = begin; k < end; k++) {
                views[k].make(geometry, geometry.views[k], z);
                needs[k] = views[k].capacity();
                apart[k] = views[k].rows_apart();
            }
        });
        capacity = 0;
        for (int64_t need : needs) capacity += need;
        stride = *std::max_element(apart.begin(), apart.end());
    }

    void prepare(Scratch& s) const {
        const bool any_tilted = std::any_of(geometry.views.begin(), geometry.views.end(),
                                            [](const View& v) { return v.resampled; });
        s.gradient.resize(geometry.grid.nx);
        s.curvature.resize(geometry.grid.nx);
        s.boxes.resize(std::max<size_t>(s.boxes.size(), capacity));
        s.pixels.resize(any_tilted ? geometry.pixels() : 0);
        s.box.resize(views.size());
    }

    // Boxes of voxel (y, x), and its slope and curvature over all views.
    void measure(int y, int x, Paraboloid& data, Scratch& s, float& slope, float& curvature) const {
        Lanes sums[2] = {};
        float* room = s.boxes.data();
        for (size_t k = 0; k < views.size(); k++) {
            views[k].box(y, x, room, s.pixels.data(), s.box[k]);
            room += int64_t(s.box[k].height) * s.box[k].width;
            gather(s.box[k], data.slope(int(k)), data.curvature(int(k)), data.stride(int(k)), sums);
        }
        slope = total(sums[0]);
        curvature = total(sums[1]);
    }
};

void descend_row(const Slice& slice, const Neighbourhood& n, const Sweep& sweep, int z, int y, Paraboloid& data,
                 Scratch& s, float* f) {
    const float beta = sweep.beta;
    float* row = f + (int64_t(z) * n.ny + y) * n.nx;
    const bool smooth = beta > 0;
    const float beside = n.weight[1][1][0];
    if (smooth) prior_across_rows(n, f, z, y, s.gradient.data(), s.curvature.data());
    for (int64_t i = 0; i < n.nx; i++) {
        const int64_t x = sweep.backwards ? n.nx - 1 - i : i;
        float gradient, curvature;
        slice.measure(y, int(x), data, s, gradient, curvature);
        const float old = row[x];
        if (smooth) {
            float slope = s.gradient[x], bend = s.curvature[x];
            for (int64_t other : {x - 1, x + 1}) {
                if (other < 0 || other >= n.nx) continue;
                const float t = old - row[other], k = beside * potential_curvature(n.potential, t, n.edge);
                slope += k * t;
                bend += k;
            }
            gradient += beta * slope;
            curvature += beta * bend;
        }
        if (!(curvature > 0)) continue; // seen by no ray, tied to no neighbour
        const float moved = std::max(0.0f, old - sweep.relaxation * gradient / curvature), change = moved - old;
        if (change == 0) continue;
        row[x] = moved;
        for (size_t k = 0; k < slice.views.size(); k++)
            spread(s.box[k], change, data.curvature(int(k)), data.stride(int(k)), data.slope(int(k)));
    }
}

} // namespace

void descend(const Geometry& geometry, const Neighbourhood& n, const Sweep& sweep, Paraboloid& data, float* f) {
    Slice slice(geometry);
    std::vector<Scratch> scratch(threads());
    for (int64_t i = 0; i < n.nz; i++) {
        const int z = int(sweep.backwards ? n.nz - 1 - i : i);
        slice.make(z);
        const int64_t stride = std::max(2, slice.stride); // neighbouring rows are bound by the prior
        for (Scratch& s : scratch) slice.prepare(s);
        const int64_t classes = std::min<int64_t>(stride, n.ny);
        for (int64_t j = 0; j < classes; j++) {
            const int64_t first = sweep.backwards ? classes - 1 - j : j;
            parallel((n.ny - first + stride - 1) / stride, [&](int64_t begin, int64_t end, int thread) {
                for (int64_t k = begin; k < end; k++)
                    descend_row(slice, n, sweep, z, int(first + k * stride), data, scratch[thread], f);
            });
        }
    }
}

void diagonal(const Geometry& geometry, Paraboloid& data, float* d) {
    const Grid& grid = geometry.grid;
    Slice slice(geometry);
    std::vector<Scratch> scratch(threads());
    for (int z = 0; z < grid.nz; z++) {
        slice.make(z);
        for (Scratch& s : scratch) slice.prepare(s);
        parallel(grid.ny, [&](int64_t begin, int64_t end, int thread) {
            for (int64_t y = begin; y < end; y++)
                for (int x = 0; x < grid.nx; x++) {
                    float slope;
                    slice.measure(int(y), x, data, scratch[thread], slope, d[z * grid.slice() + y * grid.nx + x]);
                }
        });
    }
}

int row_stride(const Geometry& geometry, int z) {
    Slice slice(geometry);
    slice.make(z);
    return slice.stride;
}

} // namespace palpate
