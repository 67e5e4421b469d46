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
            const Layout layout(v);
            const float *h1 = slope + k * geometry.pixels(), *h2 = curvature + k * geometry.pixels();
            Image& image = images[k];
            image.stride = layout.stride;
            image.slope.assign(layout.rows * layout.stride + column_padding, 0);
            image.curvature.assign(image.slope.size(), 0);
            for (int64_t row = 0; row < layout.rows; row++)
                for (int64_t column = 0; column < layout.columns; column++) {
                    const int64_t pixel = layout.start + row * layout.down + column * layout.right;
                    const float path = layout.boxed ? v.path[pixel] : 1;
                    image.slope[row * image.stride + column] = h1[pixel] * path;
                    image.curvature[row * image.stride + column] = h2[pixel] * path * path;
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

// The same two for a footprint that is a list.
void gather_list(const Box& box, const float* slope, const float* curvature, Lanes* sums) {
    for (int64_t i = 0; i < box.count; i++) {
        const float a = box.weight[i];
        sums[0][i % lanes] += a * slope[box.pixels[i]];
        sums[1][i % lanes] += a * a * curvature[box.pixels[i]];
    }
}

void spread_list(const Box& box, float change, const float* curvature, float* slope) {
    for (int64_t i = 0; i < box.count; i++) slope[box.pixels[i]] += box.weight[i] * curvature[box.pixels[i]] * change;
}

// What one thread needs, made once a sweep.
struct Scratch {
    std::vector<float> gradient, curvature; // of the prior, along a row
    std::vector<RowScratch> view;
    std::vector<Box> box;
};

// Footprints of a slice in all views.
struct Slice {
    const Geometry& geometry;
    std::vector<SliceBoxes> views;
    Footprints all; // for the views that are not boxed
    bool boxed = true;
    int stride = 1;

    explicit Slice(const Geometry& g) : geometry(g), views(g.views.size()), all(g) {
        for (const View& v : g.views) boxed = boxed && Layout(v).boxed;
    }

    void make(int z) {
        std::vector<int> apart(views.size());
        parallel(int64_t(views.size()), [&](int64_t begin, int64_t end, int) {
            for (int64_t k = begin; k < end; k++) {
                views[k].make(geometry, geometry.views[k], z);
                apart[k] = views[k].rows_apart();
            }
        });
        if (!boxed) all.prepare(z);
        stride = *std::max_element(apart.begin(), apart.end());
    }

    void begin_row(int y, Scratch& s) const {
        s.gradient.resize(geometry.grid.nx);
        s.curvature.resize(geometry.grid.nx);
        s.view.resize(views.size());
        s.box.resize(views.size());
        for (size_t k = 0; k < views.size(); k++) views[k].begin_row(y, s.view[k]);
    }

    // Footprints of voxel (y, x), and its slope and curvature over all views.
    void measure(int y, int x, Paraboloid& data, Scratch& s, float& slope, float& curvature) const {
        Lanes sums[2] = {};
        for (int k = 0; k < int(views.size()); k++) {
            Box& box = s.box[k];
            views[k].box(all, k, y, x, s.view[k], box);
            if (box.pixels)
                gather_list(box, data.slope(k), data.curvature(k), sums);
            else
                gather(box, data.slope(k), data.curvature(k), data.stride(k), sums);
        }
        slope = total(sums[0]);
        curvature = total(sums[1]);
    }

    void move(float change, Paraboloid& data, const Scratch& s) const {
        for (int k = 0; k < int(views.size()); k++) {
            if (s.box[k].pixels)
                spread_list(s.box[k], change, data.curvature(k), data.slope(k));
            else
                spread(s.box[k], change, data.curvature(k), data.stride(k), data.slope(k));
        }
    }
};

void descend_row(const Slice& slice, const Neighbourhood& n, const Sweep& sweep, int z, int y, Paraboloid& data,
                 Scratch& s, float* f) {
    const float beta = sweep.beta;
    float* row = f + (int64_t(z) * n.ny + y) * n.nx;
    const bool smooth = beta > 0;
    slice.begin_row(y, s);
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
                const float t = old - row[other], k = beside * potential_curvature(n.law, t);
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
        slice.move(change, data, s);
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
        parallel(grid.ny, [&](int64_t begin, int64_t end, int thread) {
            for (int64_t y = begin; y < end; y++) {
                slice.begin_row(int(y), scratch[thread]);
                for (int x = 0; x < grid.nx; x++) {
                    float slope;
                    slice.measure(int(y), x, data, scratch[thread], slope, d[z * grid.slice() + y * grid.nx + x]);
                }
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
