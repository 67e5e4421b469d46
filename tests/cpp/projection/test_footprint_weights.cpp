// The 1-D weights against brute-force integration: at many depths of a sub-slice, where the two edges of each voxel
// land on the panel, and what part of each pixel lies between them, times a Legendre polynomial of the depth.
#include "projection/footprint_weights.h"
#include "projection/tile_weights.h"
#include <algorithm>
#include <cmath>
#include <doctest.h>
#include <vector>

using namespace palpate;

namespace {

constexpr int pixels[2] = {23, 17}; // along x and y
const double pitch[2] = {0.7, 1.1}, panel_corner[2] = {-7, -8.5}, panel_z = -6;

ScanGeometry scan(const Vec3& source, double dz, int subslices, int moments) {
    const Grid grid{2, 9, 11, dz, 1.3, 0.9, -4.5, -5, 3};
    const double origin[3] = {panel_corner[0] + pitch[0] / 2, panel_corner[1] + pitch[1] / 2, panel_z};
    const double rows_along[3] = {0, 1, 0}, columns_along[3] = {1, 0, 0}, pitches[2] = {pitch[1], pitch[0]};
    ScanGeometry g(grid, 1, pixels[1], pixels[0], source.data(), origin, rows_along, columns_along, pitches, 1e-3);
    g.views[0].subslices = subslices;
    g.views[0].moments = moments;
    return g;
}

double legendre(int m, double t) {
    if (m == 0) return 1;
    return m == 1 ? std::sqrt(3.0) * (2 * t - 1) : std::sqrt(5.0) * (6 * t * t - 6 * t + 1);
}

using Matrix = std::vector<std::vector<double>>; // [voxel][pixel]

// An edge is taken to move evenly between the sub-slice's two faces.
Matrix integrate(const ScanGeometry& g, int z, int sub, int moment, int axis) {
    const Grid& grid = g.grid;
    const View& v = g.views[0];
    const double size = axis == 0 ? grid.dx : grid.dy, first = (axis == 0 ? grid.x0 : grid.y0) - size / 2;
    const int voxels = axis == 0 ? grid.nx : grid.ny, depths = 1500;
    const auto landing = [&](int edge, double t) { // in pixels
        double at[2];
        for (int face = 0; face < 2; face++) {
            const double height = grid.z0 + grid.dz * (z - 0.5 + double(sub + face) / v.subslices);
            const double way = (panel_z - v.source[2]) / (height - v.source[2]);
            const double x = v.source[axis] + way * (first + edge * size - v.source[axis]);
            at[face] = (x - panel_corner[axis]) / pitch[axis];
        }
        return at[0] + t * (at[1] - at[0]);
    };
    Matrix out(voxels, std::vector<double>(pixels[axis], 0));
    for (int i = 0; i < voxels; i++)
        for (int k = 0; k < depths; k++) {
            const double t = (k + 0.5) / depths, low = landing(i, t), high = landing(i + 1, t);
            for (int p = 0; p < pixels[axis]; p++)
                out[i][p] +=
                    std::max(0.0, std::min(high, p + 1.0) - std::max(low, double(p))) * legendre(moment, t) / depths;
        }
    return out;
}

double largest_difference(const Matrix& a, const Matrix& b) {
    double out = 0;
    for (size_t i = 0; i < a.size(); i++)
        for (size_t p = 0; p < a[i].size(); p++) out = std::max(out, std::fabs(a[i][p] - b[i][p]));
    return out;
}

Matrix of_voxels(const ScanGeometry& g, int z, int product, int axis) {
    AxisWeights w;
    voxel_weights(g, g.views[0], z, product, axis == 0 ? Axis::x : Axis::y, w);
    Matrix out(w.n, std::vector<double>(pixels[axis], 0));
    for (int i = 0; i < w.n; i++)
        for (int t = 0; t < w.taps; t++) out[i][w.first[i] + t] += w.weight[size_t(t) * w.n + i];
    return out;
}

// From the tiles' weights of one moment: of all pixels (forward), or of all voxels.
Matrix of_tile(const ScanGeometry& g, int z, int sub, int moment, int axis, bool forward) {
    const int voxels = axis == 0 ? g.grid.nx : g.grid.ny;
    const EdgeProjection edges = project_edges(g, g.views[0], z, sub, axis == 0 ? Axis::x : Axis::y);
    TileWeights w;
    if (forward)
        forward_weights(edges, g.views[0].moments, 0, pixels[axis], voxels, w);
    else
        backprojection_weights(edges, g.views[0].moments, 0, voxels, voxels, pixels[axis], w);
    Matrix out(voxels, std::vector<double>(pixels[axis], 0));
    for (int i = 0; w.nonempty && i < w.count; i++)
        for (int t = 0; t < w.taps; t++) {
            const int j = w.first[i] + t;
            const double weight = w.weight[size_t(moment * w.taps + t) * tile_size + i];
            if (t >= w.support[i]) REQUIRE(weight == 0);
            if (weight != 0) (forward ? out[j][i] : out[i][j]) += weight;
        }
    return out;
}

const Vec3 sources[] = {{0, 0, 60}, {9, -3, 40}, {-25, 14, 30}, {2.5, 40, 22}};

} // namespace

TEST_CASE("footprint weights are the integrals of what the edges' projections cover") {
    for (const Vec3& source : sources)
        for (double dz : {0.5, 4.0})
            for (int subslices : {1, 2}) {
                const ScanGeometry g = scan(source, dz, subslices, max_moments);
                for (int axis : {0, 1})
                    for (int product = 0; product < subslices * max_moments; product++) {
                        const int sub = product / max_moments, m = product % max_moments;
                        const Matrix exact = integrate(g, 1, sub, m, axis);
                        CAPTURE(source[0]);
                        CAPTURE(dz);
                        CAPTURE(axis);
                        CAPTURE(m);
                        CHECK(largest_difference(of_voxels(g, 1, product, axis), exact) < 1e-5);
                        CHECK(largest_difference(of_tile(g, 1, sub, m, axis, true), exact) < 2e-5);
                        CHECK(largest_difference(of_tile(g, 1, sub, m, axis, false), exact) < 2e-5);
                    }
            }
}

TEST_CASE("truncation moves small weights to the neighbour and keeps every pixel's sum") {
    for (const Vec3& source : sources) {
        ScanGeometry g = scan(source, 4.0, 1, 1);
        const Matrix all = of_voxels(g, 0, 0, 0);
        g.views[0].truncation = 0.01;
        const Matrix kept = of_voxels(g, 0, 0, 0);
        CHECK(largest_difference(kept, of_tile(g, 0, 0, 0, 0, true)) < 2e-5);
        CHECK(largest_difference(kept, of_tile(g, 0, 0, 0, 0, false)) < 2e-5);
        CHECK(largest_difference(kept, all) <= 0.02 + 1e-6);
        for (int p = 0; p < pixels[0]; p++) {
            double before = 0, after = 0;
            for (size_t i = 0; i < all.size(); i++) before += all[i][p], after += kept[i][p];
            CHECK(after == doctest::Approx(before).epsilon(1e-5));
        }
        for (size_t i = 1; i + 1 < kept.size(); i++)
            for (double w : kept[i]) CHECK((w == 0 || w > 1e-6));
    }
}

TEST_CASE("Gauss points integrate a product with a quadratic exactly") {
    for (int count = 1; count <= 3; count++)
        for (int degree = 0; degree < 2 * count; degree++) {
            double sum = 0;
            for (int i = 0; i < count; i++) {
                const GaussPoint point = gauss_point(count, i);
                sum += point.coefficient[0] * std::pow(point.at, degree); // the weight: the polynomial's mean
            }
            CHECK(sum == doctest::Approx(1.0 / (degree + 1)));
        }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) { // Lagrange: 1 at its own point, 0 at the others
            double value = 0;
            for (int m = 0; m < 3; m++) value += gauss_point(3, i).coefficient[m] * legendre(m, gauss_point(3, j).at);
            CHECK(value == doctest::Approx(i == j ? 1 : 0));
        }
}
