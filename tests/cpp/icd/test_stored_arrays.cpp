// Projection, backprojection, their adjointness and a descent sweep against arrays stored by x86-64.
#include "../stored_arrays.h"
#include "icd/coordinate_descent.h"
#include "projection/footprint_accuracy.h"
#include "projection/projector.h"

using namespace palpate;

namespace {

constexpr int rows = 14, columns = 16, views = 2;
constexpr int64_t shape[3] = {3, 8, 10}, voxels = 3 * 8 * 10, pixels = views * rows * columns;
constexpr double spacing[3] = {2.5, 1.5, 1.5}; // mm

ScanGeometry scan() {
    const Grid grid{shape[0], shape[1], shape[2], spacing[0], spacing[1], spacing[2], -6.75, -5.25, 8};
    const double source[] = {-20, 3, 90, 22, -4, 88}, origin[] = {-11.25, -9.75, 0, -11.25, -9.75, 0};
    const double down[] = {0, 1, 0, 0, 1, 0}, across[] = {1, 0, 0, 1, 0, 0}, pitch[] = {1.5, 1.5, 1.5, 1.5};
    ScanGeometry g(grid, views, rows, columns, source, origin, down, across, pitch, 1e-3);
    choose_subslices(g);
    return g;
}

double dot(const std::vector<float>& a, const std::vector<float>& b) {
    double sum = 0;
    for (size_t i = 0; i < a.size(); i++) sum += double(a[i]) * b[i];
    return sum;
}

} // namespace

TEST_CASE("projection and backprojection are adjoint, and as stored") {
    const ScanGeometry g = scan();
    const std::vector<float> f = uniform(voxels, 1), p = uniform(pixels, 2);
    std::vector<float> Af(pixels), Atp(voxels);
    project(g, f.data(), Af.data());
    backproject(g, p.data(), Atp.data());
    CHECK(dot(Af, p) == doctest::Approx(dot(f, Atp)).epsilon(1e-6));
    check_stored("projection", Af);
    check_stored("backprojection", Atp);
}

TEST_CASE("two sweeps of coordinate descent are as stored") {
    const ScanGeometry g = scan();
    std::vector<float> f = uniform(voxels, 3), slope = uniform(pixels, 4), curvature = uniform(pixels, 5);
    for (float& v : slope) v -= 0.6f;
    for (float& v : curvature) v += 0.5f;
    SurrogateImages data(g);
    data.set_slope(slope.data());
    data.set_curvature(curvature.data());
    const Neighbourhood pairs = neighbourhood(shape, spacing, {Potential::lange, 0.1f, 2, nullptr}, 26);
    for (bool backwards : {false, true}) descend(pairs, {0.2f, 1, backwards}, data, f.data());
    check_stored("descent", f);
}
