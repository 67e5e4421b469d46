#include "geometry.h"
#include "parallel.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double parallel_enough = 1e-9; // of a unit axis out of x or y
constexpr int finer = 3;                 // fine pixels along a measured one, on tilted panels

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

// A parallel panel through the middle of a tilted one, and the pixels of the tilted one seen on it from the focal spot:
// a homography, exact for the rays.
void see_through(View& v) {
    const Panel& p = v.panel;
    v.pose = Pose::tilted;
    v.start = v.step_a = v.step_b = 0;
    v.rise = 0;
    v.run = 1;
    v.height = point(p, 0.5 * (p.rows - 1), 0.5 * (p.columns - 1))[2];
    std::vector<double> corners(2 * size_t(p.rows + 1) * (p.columns + 1));
    double a0 = 1e300, a1 = -1e300, b0 = 1e300, b1 = -1e300;
    for (int r = 0; r <= p.rows; r++)
        for (int c = 0; c <= p.columns; c++) {
            const Vec3 q = point(p, r - 0.5, c - 0.5);
            const double reach = (v.height - v.source[2]) / (q[2] - v.source[2]);
            double* corner = &corners[2 * (size_t(r) * (p.columns + 1) + c)];
            for (int i = 0; i < 2; i++) corner[i] = v.source[i] + reach * (q[i] - v.source[i]);
            a0 = std::min(a0, corner[0]), a1 = std::max(a1, corner[0]);
            b0 = std::min(b0, corner[1]), b1 = std::max(b1, corner[1]);
        }
    // The middle pixel sets the fine pitch.
    const size_t middle = 2 * (size_t(p.rows / 2) * (p.columns + 1) + p.columns / 2), down = 2 * size_t(p.columns + 1);
    const double ea = corners[middle + 2] - corners[middle], eb = corners[middle + 3] - corners[middle + 1];
    const double fa = corners[middle + down] - corners[middle], fb = corners[middle + down + 1] - corners[middle + 1];
    v.pa = v.pb = std::sqrt(std::fabs(ea * fb - eb * fa)) / finer;
    v.na = int(std::ceil((a1 - a0) / v.pa)) + 1;
    v.nb = int(std::ceil((b1 - b0) / v.pb)) + 1;
    v.left = a0 + 0.5 * v.pa;
    v.low = b0 + 0.5 * v.pb;
    for (size_t i = 0; i < corners.size(); i += 2) {
        corners[i] = (corners[i] - v.left) / v.pa;
        corners[i + 1] = (corners[i + 1] - v.low) / v.pb;
    }
    v.resampling = resampling(p.rows, p.columns, corners, v.na, v.nb);
}

// The product of two trapezoids is the mean over the slice's thickness only if the shadow moves along one axis: moving
// along both, by mx and my pixels or voxels (the wider), errs by about 0.1 mx my on white noise. Sub-slices cut both
// moves.
int sub_slices(const Grid& g, const View& v, double tolerance) {
    double most = 1;
    for (int corner = 0; corner < 8; corner++) {
        const double x = g.x0 + (corner & 1 ? g.nx - 0.5 : -0.5) * g.dx;
        const double y = g.y0 + (corner & 2 ? g.ny - 0.5 : -0.5) * g.dy;
        const double z = g.z0 + (corner & 4 ? g.nz - 0.5 : -0.5) * g.dz;
        const double shrink = (v.source[2] - z) / (v.source[2] - v.height);
        const double across = g.dz / (v.source[2] - z);
        const double mx = std::fabs(x - v.source[0]) * across / std::max(g.dx, v.pa * shrink);
        const double my = std::fabs(y - v.source[1]) * across / std::max(g.dy, v.pb * shrink);
        most = std::max(most, std::ceil(std::sqrt(0.1 * mx * my / tolerance)));
    }
    return int(std::min(most, 64.0));
}

void paths(const Grid& g, View& v) {
    const Panel& p = v.panel;
    v.path.resize(size_t(p.rows) * p.columns);
    for (int r = 0; r < p.rows; r++)
        for (int c = 0; c < p.columns; c++) {
            Vec3 ray = point(p, r, c);
            for (int i = 0; i < 3; i++) ray[i] -= v.source[i];
            v.path[size_t(r) * p.columns + c] = float(g.dz / v.subs * std::sqrt(dot(ray, ray)) / std::fabs(ray[2]));
        }
}

} // namespace

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
            swap_xy(v), see_through(v);
        else
            adopt(v);
        v.subs = sub_slices(seen_by(v), v, tolerance);
        paths(grid, v);
    }
}

} // namespace palpate
