#pragma once
#include "resample.h"
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

namespace palpate {

using Vec3 = std::array<double, 3>;

// Voxel (z, y, x) of value f[(z * ny + y) * nx + x]; centre of voxel (0, 0, 0) at (x0, y0, z0) mm.
struct Grid {
    int nz, ny, nx;
    double dz, dy, dx;
    double x0, y0, z0;
    int64_t slice() const { return int64_t(ny) * nx; }
};

// A flat panel: centre of pixel (row, column) at origin + row * dv * rows_along + column * du * columns_along.
struct Panel {
    Vec3 origin, rows_along, columns_along;
    double dv, du;
    int rows, columns;
};

// Length of a ray inside one sub-slice: thickness / cos, for pixels of the measured image.
struct Path {
    Vec3 first, row, column; // from the focal spot to pixel 0; from a pixel to the next row, to the next column
    double thickness;        // of a sub-slice
    int columns;

    // mm, of `count` pixels from number `pixel` on, `step` apart (a row of the image, or a column).
    void operator()(int64_t pixel, int64_t step, int count, float* out) const;
    float operator()(int64_t pixel) const {
        float out;
        (*this)(pixel, 1, 1, &out);
        return out;
    }
};

// How the panel stands to the slices, which decides how a view is projected.
enum class Pose {
    parallel, // to the slices, axes along x and y: separable
    turned,   // about y (or x, after swapping the two): columns are separable, the magnification differs by column
    tilted,   // any other: through a finer parallel panel on which the same rays land
};

constexpr int most_moments = 3;

// One view as the kernels see it. `image` pixel (b, a), a roughly along x, b along y, is number
// start + b * step_b + a * step_a of the measured image, unless tilted: then `resampling` averages the image over each
// measured pixel. Where `swapped`, x and y of source, panel and grid have changed places (a mirror image of the world,
// in which line integrals are the same), so that every turned panel is turned about y.
struct View {
    Vec3 source;
    Panel panel;
    Pose pose;
    bool swapped;
    double left, low, pa, pb; // pixel (b, a) of a parallel image is centred at x = left + a * pa, y = low + b * pb
    double height, rise, run; // z of column a is height + a * pa * rise, its x is left + a * pa * run (run > 0)
    int na, nb;
    int64_t start, step_a, step_b;
    Resampling resampling; // empty unless tilted
    int subs;              // sub-slices a slice
    int moments;           // products of 1-D weights a sub-slice: see AxisWeights
    double trim;           // of the weights: see cover
    // Rows of voxels less than band[m] from row `still`, under the source, need no more than m moments. No row does on
    // a turned panel.
    double still;
    std::array<double, most_moments> band;
    bool calm(int row, int m) const { return row > still - band[m] && row < still + band[m]; }
    int moments_of(int row) const {
        int m = 1;
        while (m < moments && !calm(row, m)) m++;
        return m;
    }
    Path path;
};

struct Geometry {
    Grid grid;
    int rows, columns;
    double tolerance;
    std::vector<View> views;
    int64_t pixels() const { return int64_t(rows) * columns; }

    // The grid as a view sees it.
    Grid seen_by(const View& view) const {
        Grid g = grid;
        if (view.swapped) std::swap(g.nx, g.ny), std::swap(g.dx, g.dy), std::swap(g.x0, g.y0);
        return g;
    }

    // source, origin, rows_along, columns_along: (views, 3); pitch: (views, 2) as (dv, du).
    Geometry(const Grid& grid, int views, int rows, int columns, const double* source, const double* origin,
             const double* rows_along, const double* columns_along, const double* pitch, double tolerance);
};

} // namespace palpate
