#include "geometry.h"
#include "dispatch.h"
#include "parallel.h"
#include "subslices.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double parallel_enough = 1e-9; // of a unit axis out of x or y
constexpr int finer = 2;                 // fine pixels along a measured one, on tilted panels

double dot(const Vec3& u, const Vec3& v) { return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]; }

Vec3 point(const Panel& p, double row, double column) {
    Vec3 q;
    for (int i = 0; i < 3; i++) q[i] = p.origin[i] + row * p.dv * p.rows_along[i] + column * p.du * p.columns_along[i];
    return q;
}

bool along(const Vec3& axis, int i) { return std::fabs(std::fabs(axis[i]) - 1) < parallel_enough; }

// Pixels of the panel are those of the image; only their order and direction may differ. Rows along y, or columns, and
// the other axis in the x-z plane.
void adopt(View& v) {
    const Panel& p = v.panel;
    const bool crossed = along(p.columns_along, 1); // the column index grows along y
    const Vec3 &ax = crossed ? p.rows_along : p.columns_along, &by = crossed ? p.columns_along : p.rows_along;
    v.pose = along(ax, 0) ? Pose::parallel : Pose::turned;
    v.pa = crossed ? p.dv : p.du;
    v.pb = crossed ? p.du : p.dv;
    v.na = crossed ? p.rows : p.columns;
    v.nb = crossed ? p.columns : p.rows;
    v.step_a = crossed ? p.columns : 1;
    v.step_b = crossed ? 1 : p.columns;
    v.left = p.origin[0];
    v.height = p.origin[2];
    v.low = p.origin[1];
    v.run = ax[0];
    v.rise = v.pose == Pose::parallel ? 0 : ax[2];
    v.start = 0;
    if (v.run < 0) {
        v.left += (v.na - 1) * v.pa * v.run;
        v.height += (v.na - 1) * v.pa * v.rise;
        v.start += (v.na - 1) * v.step_a;
        v.step_a = -v.step_a;
        v.run = -v.run;
        v.rise = -v.rise;
    }
    if (by[1] < 0) {
        v.low -= (v.nb - 1) * v.pb;
        v.start += (v.nb - 1) * v.step_b;
        v.step_b = -v.step_b;
    }
}

// Whether one panel axis lies along y and the other in the x-z plane, not on edge.
bool about_y(const Panel& p) {
    const bool crossed = along(p.columns_along, 1);
    return (crossed || along(p.rows_along, 1)) && std::fabs((crossed ? p.rows_along : p.columns_along)[0]) > 0.05;
}

void swap_xy(View& v) {
    v.swapped = !v.swapped;
    for (Vec3* u : {&v.source, &v.panel.origin, &v.panel.rows_along, &v.panel.columns_along})
        std::swap((*u)[0], (*u)[1]);
}

// Where the ray from the source through q meets the plane of the parallel panel; not finite if it runs away from it.
std::array<double, 2> cast(const View& v, const Vec3& q) {
    const double reach = (v.height - v.source[2]) / (q[2] - v.source[2]);
    if (!(reach > 0)) return {NAN, NAN};
    return {v.source[0] + reach * (q[0] - v.source[0]), v.source[1] + reach * (q[1] - v.source[1])};
}

struct Box {
    double low[2] = {HUGE_VAL, HUGE_VAL}, high[2] = {-HUGE_VAL, -HUGE_VAL};
    void take(const std::array<double, 2>& p) {
        for (int i = 0; i < 2; i++) low[i] = std::fmin(low[i], p[i]), high[i] = std::fmax(high[i], p[i]);
    }
};

Box grid_shadow(const Grid& g, const View& v) {
    Box box;
    for (int corner = 0; corner < 8; corner++)
        box.take(
            cast(v, {g.x0 + (corner & 1 ? g.nx - 0.5 : -0.5) * g.dx, g.y0 + (corner & 2 ? g.ny - 0.5 : -0.5) * g.dy,
                     g.z0 + (corner & 4 ? g.nz - 0.5 : -0.5) * g.dz}));
    return box;
}

// The pixel of the measured panel that sees the middle of the grid, or the one nearest to it.
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

// A parallel panel at the height of the tilted one's middle pixel, no larger than the grid's shadow, and the pixels of
// the tilted one seen on it from the focal spot: a homography, exact for the rays.
void see_through(const Grid& g, View& v) {
    const Panel& p = v.panel;
    v.pose = Pose::tilted;
    v.start = v.step_a = v.step_b = 0;
    v.rise = 0;
    v.run = 1;
    const auto [row, column] = middle_pixel(g, v);
    v.height = point(p, row, column)[2];
    std::vector<double> corners(2 * size_t(p.rows + 1) * (p.columns + 1));
    Box seen;
    for (int r = 0; r <= p.rows; r++)
        for (int c = 0; c <= p.columns; c++) {
            const auto at = cast(v, point(p, r - 0.5, c - 0.5));
            seen.take(at);
            std::copy_n(at.begin(), 2, &corners[2 * (size_t(r) * (p.columns + 1) + c)]);
        }
    // The middle pixel sets the fine pitch, along x and y apart: its two edges' extents.
    const double* corner = &corners[2 * (size_t(row) * (p.columns + 1) + column)];
    const double* below = corner + 2 * size_t(p.columns + 1);
    v.pa = std::hypot(corner[2] - corner[0], below[0] - corner[0]) / finer;
    v.pb = std::hypot(corner[3] - corner[1], below[1] - corner[1]) / finer;
    const Box shadow = grid_shadow(g, v);
    for (int i = 0; i < 2; i++) {
        const double pitch = i ? v.pb : v.pa, margin = 2 * finer * pitch; // whole measured pixels beside the shadow
        const double low = std::fmax(seen.low[i], shadow.low[i] - margin);
        const double high = std::fmin(seen.high[i], shadow.high[i] + margin);
        (i ? v.nb : v.na) = std::max(1, int(std::ceil((high - low) / pitch)));
        (i ? v.low : v.left) = low + 0.5 * pitch;
    }
    for (size_t i = 0; i < corners.size(); i += 2) {
        corners[i] = (corners[i] - v.left) / v.pa;
        corners[i + 1] = (corners[i + 1] - v.low) / v.pb;
    }
    v.resampling = resampling(p.rows, p.columns, corners, v.na, v.nb);
}

void walk(const Grid& g, View& v) {
    const Panel& p = v.panel;
    for (int i = 0; i < 3; i++) {
        v.path.first[i] = p.origin[i] - v.source[i];
        v.path.row[i] = p.dv * p.rows_along[i];
        v.path.column[i] = p.du * p.columns_along[i];
    }
    v.path.thickness = g.dz / v.subs;
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

void Path::operator()(int64_t pixel, int64_t step, int count, float* out) const {
    const auto r = double(pixel / columns), c = double(pixel % columns);
    const auto down = double(step / columns), right = double(step % columns);
    float from[3], along[3];
    for (int i = 0; i < 3; i++) {
        from[i] = float(first[i] + r * row[i] + c * column[i]);
        along[i] = float(down * row[i] + right * column[i]);
    }
    ray_lengths(from, along, float(thickness), count, out);
}

Geometry::Geometry(const Grid& grid, int count, int rows, int columns, const double* source, const double* origin,
                   const double* rows_along, const double* columns_along, const double* pitch, double tolerance)
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
        if (!about_y(p)) swap_xy(v);
        if (!about_y(p))
            swap_xy(v), see_through(grid, v);
        else
            adopt(v);
    }
    parallel(count, [&](int64_t begin, int64_t end, int) {
        for (int64_t k = begin; k < end; k++) {
            cut(*this, views[k]);
            walk(grid, views[k]);
        }
    });
}

} // namespace palpate
