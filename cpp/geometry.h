#pragma once
#include "resample.h"
#include <array>
#include <cstdint>
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

// One view, and the parallel panel in the plane z = height on which the separable projector works. Its pixel (b, a) is
// centred at x = left + a * pa, y = low + b * pb. If the real panel lies parallel to the slices with its axes along x
// and y, the two are one: pixel (b, a) is number start + b * step_b + a * step_a of the measured image. Otherwise the
// parallel panel is a finer one through which the same rays pass, and `resampling` averages it over each real pixel.
struct View {
    Vec3 source;
    Panel panel;
    double height, left, low, pa, pb;
    int na, nb;
    bool resampled;
    int64_t start, step_a, step_b;
    Resampling resampling;   // empty unless resampled
    int subs;                // sub-slices a slice; A's weights are means over each sub-slice's thickness
    std::vector<float> path; // mm of ray in one sub-slice, per real pixel: thickness / cos
};

struct Geometry {
    Grid grid;
    int rows, columns;
    double tolerance;
    std::vector<View> views;
    int64_t pixels() const { return int64_t(rows) * columns; }

    // source, origin, rows_along, columns_along: (views, 3); pitch: (views, 2) as (dv, du).
    Geometry(const Grid& grid, int views, int rows, int columns, const double* source, const double* origin,
             const double* rows_along, const double* columns_along, const double* pitch, double tolerance);
};

} // namespace palpate
