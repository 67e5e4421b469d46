// The geometry of a scan: grid, panels, focal spots, and how each view is projected.
// Made once per projector and then only read, by the kernels of projection/ and icd/ on all threads.
#pragma once
#include "projection/panel_resampling.h"
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

namespace palpate {

using Vec3 = std::array<double, 3>;

// The value of voxel (z, y, x) is f[(z * ny + y) * nx + x]. The centre of voxel (0, 0, 0) is at (x0, y0, z0) mm.
struct Grid {
    int nz, ny, nx;
    double dz, dy, dx;
    double x0, y0, z0;
    int64_t slice() const { return int64_t(ny) * nx; }
};

// A flat panel. The centre of pixel (row, column) is at origin + row * dv * rows_along + column * du * columns_along.
struct Panel {
    Vec3 origin, rows_along, columns_along;
    double dv, du;
    int rows, columns;
};

// The length of a ray inside one sub-slice, thickness / cos, for pixels of the measured image.
struct RayPath {
    Vec3 first, row, column; // from the focal spot to pixel 0; from a pixel to the next row, to the next column
    double thickness;        // of a sub-slice
    int columns;

    // In mm, of `count` pixels from number `pixel` on, `step` apart (along a row of the image, or a column).
    void operator()(int64_t pixel, int64_t step, int count, float* out) const;
    float operator()(int64_t pixel) const {
        float out;
        (*this)(pixel, 1, 1, &out);
        return out;
    }
};

// The orientation of the panel to the slices. It decides how a view is projected.
enum class PanelOrientation {
    parallel, // to the slices, its axes along x and y: separable
    rotated,  // about y (or x, after swapping the two): columns are separable, the magnification differs by column
    oblique,  // any other: by way of a finer parallel panel that the same rays meet
};

constexpr int max_moments = 3;

// One view as the kernels see it. Its image has na columns, roughly along x, and nb rows, along y. Pixel (b, a) is
// pixel number start + b * step_b + a * step_a of the measured image. If the panel is oblique, the image is a finer
// one instead, and `resampling` averages it over each measured pixel. If `swapped`, x and y of source, panel and grid
// are exchanged, a reflection that keeps line integrals; so every rotated panel is rotated about y.
struct View {
    Vec3 source;
    Panel panel;
    PanelOrientation orientation;
    bool swapped;
    // Pixel (b, a) is centred at x = first_x + a * pitch_a * axis_x, y = first_y + b * pitch_b and
    // z = first_z + a * pitch_a * axis_z, where axis_x > 0; on a parallel image axis_x = 1 and axis_z = 0.
    double first_x, first_y, pitch_a, pitch_b, first_z, axis_z, axis_x;
    int na, nb;
    int64_t start, step_a, step_b;
    Resampling resampling; // empty unless oblique
    int subslices = 1;     // of a slice; chosen by choose_subslices
    int moments = 1;       // Legendre moments of a sub-slice: see AxisWeights
    double truncation = 0; // of small weights: see MovingEdge::legendre_moments
    // Rows of voxels within half_width[m] of row `source_row`, which lies under the source, need only m moments:
    // their projections move little along y. On a rotated panel there are no such rows.
    double source_row = 0;
    std::array<double, max_moments> half_width = {};
    bool moments_suffice(int row, int m) const {
        return row > source_row - half_width[m] && row < source_row + half_width[m];
    }
    int moments_of(int row) const {
        int m = 1;
        while (m < moments && !moments_suffice(row, m)) m++;
        return m;
    }
    RayPath path;
};

struct ScanGeometry {
    Grid grid;
    int rows, columns;
    double tolerance;
    std::vector<View> views;
    int64_t pixels() const { return int64_t(rows) * columns; }

    // The grid, with x and y exchanged if the view has them exchanged.
    Grid seen_by(const View& view) const {
        Grid g = grid;
        if (view.swapped) std::swap(g.nx, g.ny), std::swap(g.dx, g.dy), std::swap(g.x0, g.y0);
        return g;
    }

    // The same rays through slices first .. end - 1, with as many products each.
    ScanGeometry slices(int first, int end) const {
        ScanGeometry part = *this;
        part.grid.nz = end - first, part.grid.z0 += first * grid.dz;
        return part;
    }

    // source, origin, rows_along, columns_along: (views, 3); pitch: (views, 2) as (dv, du).
    // oversampling: see project_onto_parallel_panel.
    ScanGeometry(const Grid& grid, int views, int rows, int columns, const double* source, const double* origin,
                 const double* rows_along, const double* columns_along, const double* pitch, double tolerance,
                 int oversampling = 2);
};

} // namespace palpate
