// Columns of the system matrix against ray casting, and backprojection against the transpose of projection.
#include "projection/footprint_accuracy.h"
#include "projection/projector.h"
#include "projection/voxel_footprint.h"
#include <algorithm>
#include <cmath>
#include <doctest.h>
#include <random>
#include <vector>

using namespace palpate;

namespace {

constexpr int rows = 30, columns = 34;

// A panel of 1.1 x 0.9 mm pixels whose middle lies at (0, 0, -10): turned by the angle `b` about x, then by `a` about
// y.
ScanGeometry scan(double a, double b, const Grid& grid) {
    const double source[3] = {4 + 60 * std::sin(a), -2, 80};
    const double across[3] = {std::cos(a), 0, -std::sin(a)};
    const double down[3] = {std::sin(a) * std::sin(b), std::cos(b), std::cos(a) * std::sin(b)};
    double origin[3];
    for (int i = 0; i < 3; i++)
        origin[i] = (i == 2 ? -10 : 0) - (columns - 1) * 0.45 * across[i] - (rows - 1) * 0.55 * down[i];
    const double pitch[2] = {1.1, 0.9};
    ScanGeometry g(grid, 1, rows, columns, source, origin, down, across, pitch, 1e-3);
    choose_subslices(g);
    return g;
}

// Length within the box low .. high of the ray from s to e.
double chord(const Vec3& s, const Vec3& e, const Vec3& low, const Vec3& high) {
    double enter = 0, leave = 1, square = 0;
    for (int i = 0; i < 3; i++) {
        const double d = e[i] - s[i], t0 = (low[i] - s[i]) / d, t1 = (high[i] - s[i]) / d;
        enter = std::max(enter, std::min(t0, t1));
        leave = std::min(leave, std::max(t0, t1));
        square += d * d;
    }
    return std::max(0.0, leave - enter) * std::sqrt(square);
}

// Mean chord of the rays to a pixel.
double cast(const Panel& p, const Vec3& source, int pixel, const Vec3& low, const Vec3& high) {
    constexpr int n = 24;
    double sum = 0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const double r = pixel / columns - 0.5 + (i + 0.5013) / n, c = pixel % columns - 0.5 + (j + 0.5017) / n;
            Vec3 end;
            for (int k = 0; k < 3; k++)
                end[k] = p.origin[k] + r * p.dv * p.rows_along[k] + c * p.du * p.columns_along[k];
            sum += chord(source, end, low, high);
        }
    return sum / (n * n);
}

struct Turn {
    double a, b;
    PanelOrientation orientation;
    double allowed; // relative error of a footprint (L2)
};

} // namespace

TEST_CASE("a column of the system matrix is the voxel's mean chords") {
    const Grid grid{1, 8, 7, 3, 2.5, 2, -6, -9, 5};
    for (const Turn& turn :
         {Turn{0, 0, PanelOrientation::parallel, 0.01}, Turn{0.3, 0, PanelOrientation::rotated, 0.01},
          Turn{0, 0.25, PanelOrientation::rotated, 0.01}, Turn{0.3, 0.2, PanelOrientation::oblique, 0.1}}) {
        const ScanGeometry g = scan(turn.a, turn.b, grid);
        const View& v = g.views[0];
        REQUIRE(v.orientation == turn.orientation);
        Panel panel = v.panel;
        Vec3 source = v.source;
        if (v.swapped)
            for (Vec3* u : {&source, &panel.origin, &panel.rows_along, &panel.columns_along})
                std::swap((*u)[0], (*u)[1]);
        VoxelFootprint footprint(g);
        footprint.prepare(0);
        for (int y : {0, 4, 7})
            for (int x : {0, 3, 6}) {
                std::vector<double> column(rows * columns, 0.0);
                footprint.visit(0, y, x, [&](int64_t pixel, float w) { column[pixel] += w; });
                const Vec3 low = {grid.x0 + (x - 0.5) * grid.dx, grid.y0 + (y - 0.5) * grid.dy,
                                  grid.z0 - 0.5 * grid.dz};
                const Vec3 high = {low[0] + grid.dx, low[1] + grid.dy, low[2] + grid.dz};
                double error = 0, square = 0;
                for (int pixel = 0; pixel < rows * columns; pixel++) {
                    const double exact = cast(panel, source, pixel, low, high);
                    error += (column[pixel] - exact) * (column[pixel] - exact), square += exact * exact;
                }
                REQUIRE(square > 1);
                CAPTURE(turn.a);
                CAPTURE(turn.b);
                CHECK(std::sqrt(error / square) < turn.allowed);
            }
    }
}

TEST_CASE("backprojection is the transpose of projection, and a projection the sum of its columns") {
    const Grid grid{6, 21, 26, 2, 1, 1, -12.5, -10, 3};
    std::mt19937 random(1);
    std::uniform_real_distribution<float> uniform(0, 1);
    for (const Turn& turn :
         {Turn{0, 0, PanelOrientation::parallel, 0}, Turn{0.3, 0, PanelOrientation::rotated, 0},
          Turn{0, 0.25, PanelOrientation::rotated, 0}, Turn{0.3, 0.2, PanelOrientation::oblique, 0}}) {
        const ScanGeometry g = scan(turn.a, turn.b, grid);
        std::vector<float> f(grid.nz * grid.slice()), p(rows * columns), y(p.size()), back(f.size());
        for (float& value : f) value = uniform(random);
        for (float& value : y) value = uniform(random);
        project(g, f.data(), p.data());
        backproject(g, y.data(), back.data());
        double left = 0, right = 0;
        for (size_t i = 0; i < p.size(); i++) left += double(p[i]) * y[i];
        for (size_t i = 0; i < f.size(); i++) right += double(f[i]) * back[i];
        CHECK(left == doctest::Approx(right).epsilon(1e-5));
        std::vector<double> sum(p.size(), 0.0);
        VoxelFootprint footprint(g);
        for (int z = 0; z < grid.nz; z++) {
            footprint.prepare(z);
            for (int row = 0; row < grid.ny; row++)
                for (int x = 0; x < grid.nx; x++)
                    footprint.visit(0, row, x, [&](int64_t pixel, float w) {
                        sum[pixel] += double(w) * f[(int64_t(z) * grid.ny + row) * grid.nx + x];
                    });
        }
        const double most = *std::max_element(sum.begin(), sum.end());
        for (size_t i = 0; i < p.size(); i++) CHECK(std::fabs(p[i] - sum[i]) < 2e-5 * most);
    }
}
