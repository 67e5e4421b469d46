#include "projection/scan_geometry.h"
#include "base/cpu_dispatch.h"
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace palpate {
namespace {

constexpr double parallel_enough = 1e-9; // of a unit axis out of x or y
constexpr double most_fine_pixels = 1e6; // along one axis

double dot(const Vec3& u, const Vec3& v) { return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]; }

Vec3 point(const Panel& p, double row, double column) {
    Vec3 q;
    for (int i = 0; i < 3; i++) q[i] = p.origin[i] + row * p.dv * p.rows_along[i] + column * p.du * p.columns_along[i];
    return q;
}

bool is_along(const Vec3& axis, int i) { return std::fabs(std::fabs(axis[i]) - 1) < parallel_enough; }

// The image's pixels are the panel's; only their order and direction may differ. One panel axis is along y, the other
// in the x-z plane.
void use_panel_pixels(View& v) {
    const Panel& p = v.panel;
    const bool crossed = is_along(p.columns_along, 1); // the column index grows along y
    const Vec3 &ax = crossed ? p.rows_along : p.columns_along, &by = crossed ? p.columns_along : p.rows_along;
    v.orientation = is_along(ax, 0) ? PanelOrientation::parallel : PanelOrientation::rotated;
    v.pitch_a = crossed ? p.dv : p.du;
    v.pitch_b = crossed ? p.du : p.dv;
    v.na = crossed ? p.rows : p.columns;
    v.nb = crossed ? p.columns : p.rows;
    v.step_a = crossed ? p.columns : 1;
    v.step_b = crossed ? 1 : p.columns;
    v.first_x = p.origin[0];
    v.first_z = p.origin[2];
    v.first_y = p.origin[1];
    v.axis_x = ax[0];
    v.axis_z = v.orientation == PanelOrientation::parallel ? 0 : ax[2];
    v.start = 0;
    if (v.axis_x < 0) {
        v.first_x += (v.na - 1) * v.pitch_a * v.axis_x;
        v.first_z += (v.na - 1) * v.pitch_a * v.axis_z;
        v.start += (v.na - 1) * v.step_a;
        v.step_a = -v.step_a;
        v.axis_x = -v.axis_x;
        v.axis_z = -v.axis_z;
    }
    if (by[1] < 0) {
        v.first_y -= (v.nb - 1) * v.pitch_b;
        v.start += (v.nb - 1) * v.step_b;
        v.step_b = -v.step_b;
    }
}

// Whether one panel axis lies along y and the other in the x-z plane, and the panel is not seen edge on.
bool is_rotated_about_y(const Panel& p) {
    const bool crossed = is_along(p.columns_along, 1);
    return (crossed || is_along(p.rows_along, 1)) && std::fabs((crossed ? p.rows_along : p.columns_along)[0]) > 0.05;
}

void swap_xy(View& v) {
    v.swapped = !v.swapped;
    for (Vec3* u : {&v.source, &v.panel.origin, &v.panel.rows_along, &v.panel.columns_along})
        std::swap((*u)[0], (*u)[1]);
}

// Where the ray from the source through q meets the plane of the parallel panel; NaN if it does not.
std::array<double, 2> project_to_panel(const View& v, const Vec3& q) {
    const double reach = (v.first_z - v.source[2]) / (q[2] - v.source[2]);
    if (!(reach > 0)) return {NAN, NAN};
    return {v.source[0] + reach * (q[0] - v.source[0]), v.source[1] + reach * (q[1] - v.source[1])};
}

struct Box {
    double low[2] = {HUGE_VAL, HUGE_VAL}, high[2] = {-HUGE_VAL, -HUGE_VAL};
    void extend(const std::array<double, 2>& p) {
        for (int i = 0; i < 2; i++) low[i] = std::fmin(low[i], p[i]), high[i] = std::fmax(high[i], p[i]);
    }
};

Box grid_projection(const Grid& g, const View& v) {
    Box box;
    for (int corner = 0; corner < 8; corner++)
        box.extend(project_to_panel(v, {g.x0 + (corner & 1 ? g.nx - 0.5 : -0.5) * g.dx,
                                        g.y0 + (corner & 2 ? g.ny - 0.5 : -0.5) * g.dy,
                                        g.z0 + (corner & 4 ? g.nz - 0.5 : -0.5) * g.dz}));
    return box;
}

// The measured pixel that sees the centre of the grid, or the one nearest to it.
std::array<int, 2> middle_pixel(const Grid& g, const View& v) {
    const Panel& p = v.panel;
    const Vec3 normal = {p.columns_along[1] * p.rows_along[2] - p.columns_along[2] * p.rows_along[1],
                         p.columns_along[2] * p.rows_along[0] - p.columns_along[0] * p.rows_along[2],
                         p.columns_along[0] * p.rows_along[1] - p.columns_along[1] * p.rows_along[0]};
    const Vec3 middle = {g.x0 + 0.5 * (g.nx - 1) * g.dx, g.y0 + 0.5 * (g.ny - 1) * g.dy,
                         g.z0 + 0.5 * (g.nz - 1) * g.dz};
    Vec3 ray, away, hit;
    for (int i = 0; i < 3; i++) ray[i] = middle[i] - v.source[i], away[i] = p.origin[i] - v.source[i];
    const double reach = dot(away, normal) / dot(ray, normal);
    for (int i = 0; i < 3; i++) hit[i] = reach * ray[i] - away[i];
    const double row = dot(hit, p.rows_along) / p.dv, column = dot(hit, p.columns_along) / p.du;
    return {int(std::fmin(std::fmax(row, 0.0), p.rows - 1.0)), int(std::fmin(std::fmax(column, 0.0), p.columns - 1.0))};
}

// Replaces an oblique panel by a parallel one at the height of its middle pixel, no larger than the grid's
// projection, with `oversampling` fine pixels along a measured one. Measured pixels are projected onto it from the
// focal spot, by a homography that is exact for the rays.
void project_onto_parallel_panel(const Grid& g, int oversampling, View& v) {
    const Panel& p = v.panel;
    v.orientation = PanelOrientation::oblique;
    v.start = v.step_a = v.step_b = 0;
    v.axis_z = 0;
    v.axis_x = 1;
    const auto [row, column] = middle_pixel(g, v);
    v.first_z = point(p, row, column)[2];
    std::vector<double> corners(2 * size_t(p.rows + 1) * (p.columns + 1));
    Box panel_box;
    for (int r = 0; r <= p.rows; r++)
        for (int c = 0; c <= p.columns; c++) {
            const auto at = project_to_panel(v, point(p, r - 0.5, c - 0.5));
            panel_box.extend(at);
            std::copy_n(at.begin(), 2, &corners[2 * (size_t(r) * (p.columns + 1) + c)]);
        }
    // The extents of the middle pixel's two edges set the fine pitches along x and y.
    const double* corner = &corners[2 * (size_t(row) * (p.columns + 1) + column)];
    const double* below = corner + 2 * size_t(p.columns + 1);
    v.pitch_a = std::hypot(corner[2] - corner[0], below[0] - corner[0]) / oversampling;
    v.pitch_b = std::hypot(corner[3] - corner[1], below[1] - corner[1]) / oversampling;
    const Box grid_box = grid_projection(g, v);
    for (int i = 0; i < 2; i++) {
        const double pitch = i ? v.pitch_b : v.pitch_a,
                     margin = 2 * oversampling * pitch; // whole measured pixels around the grid's projection
        const double low = std::fmax(panel_box.low[i], grid_box.low[i] - margin);
        const double high = std::fmin(panel_box.high[i], grid_box.high[i] + margin);
        const double pixels = std::ceil((high - low) / pitch);
        if (!(pixels < most_fine_pixels)) throw std::invalid_argument("panel: seen edge on, or from too near");
        (i ? v.nb : v.na) = std::max(1, int(std::fmax(pixels, 1)));
        (i ? v.first_y : v.first_x) = low + 0.5 * pitch;
    }
    for (size_t i = 0; i < corners.size(); i += 2) {
        corners[i] = (corners[i] - v.first_x) / v.pitch_a;
        corners[i + 1] = (corners[i + 1] - v.first_y) / v.pitch_b;
    }
    v.resampling = resampling(p.rows, p.columns, corners, v.na, v.nb);
}

void set_ray_path(const Grid& g, View& v) {
    const Panel& p = v.panel;
    for (int i = 0; i < 3; i++) {
        v.path.first[i] = p.origin[i] - v.source[i];
        v.path.row[i] = p.dv * p.rows_along[i];
        v.path.column[i] = p.du * p.columns_along[i];
    }
    v.path.thickness = g.dz / v.subslices;
    v.path.columns = p.columns;
}

} // namespace

PALPATE_KERNEL void ray_lengths(const float* from, const float* step, float thickness, int count,
                                float* __restrict out) {
    if (step[2] == 0) {
        const float scale = thickness / std::fabs(from[2]), square = from[2] * from[2];
        for (int i = 0; i < count; i++) {
            const float x = from[0] + float(i) * step[0], y = from[1] + float(i) * step[1];
            out[i] = scale * std::sqrt(x * x + y * y + square);
        }
        return;
    }
    for (int i = 0; i < count; i++) {
        const float x = from[0] + float(i) * step[0], y = from[1] + float(i) * step[1],
                    z = from[2] + float(i) * step[2];
        out[i] = thickness * std::sqrt(x * x + y * y + z * z) / std::fabs(z);
    }
}

void RayPath::operator()(int64_t pixel, int64_t step, int count, float* out) const {
    const auto r = double(pixel / columns), c = double(pixel % columns);
    const auto down = double(step / columns), right = double(step % columns);
    float from[3], pixel_step[3];
    for (int i = 0; i < 3; i++) {
        from[i] = float(first[i] + r * row[i] + c * column[i]);
        pixel_step[i] = float(down * row[i] + right * column[i]);
    }
    ray_lengths(from, pixel_step, float(thickness), count, out);
}

ScanGeometry::ScanGeometry(const Grid& grid, int count, int rows, int columns, const double* source,
                           const double* origin, const double* rows_along, const double* columns_along,
                           const double* pitch, double tolerance, int oversampling)
    : grid(grid), rows(rows), columns(columns), tolerance(tolerance), views(count) {
    for (int k = 0; k < count; k++) {
        View& v = views[k];
        for (int i = 0; i < 3; i++) {
            v.source[i] = source[3 * k + i];
            v.panel.origin[i] = origin[3 * k + i];
            v.panel.rows_along[i] = rows_along[3 * k + i];
            v.panel.columns_along[i] = columns_along[3 * k + i];
        }
        v.panel.dv = pitch[2 * k];
        v.panel.du = pitch[2 * k + 1];
        v.panel.rows = rows;
        v.panel.columns = columns;
        const Panel& p = v.panel;
        v.swapped = false;
        if (!is_rotated_about_y(p)) swap_xy(v);
        if (!is_rotated_about_y(p))
            swap_xy(v), project_onto_parallel_panel(grid, oversampling, v);
        else
            use_panel_pixels(v);
        set_ray_path(grid, v);
    }
}

} // namespace palpate
