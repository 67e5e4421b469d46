// What a blade leaves of a cube: the parts fill it, neighbours fit, and the faces that were passed are the blade.
#include "cutting/slit_complex.h"
#include "kuhn_cube.h"
#include <algorithm>
#include <cmath>
#include <doctest.h>

using namespace palpate;

namespace {

struct Cube : KuhnCube {
    SlitComplex complex() const { return {node.data(), 27, tet.data(), int(tet.size() / 4), 1e-9}; }
};

Point3 at(const SlitComplex& slit, int p) {
    return {slit.place[3 * size_t(p)], slit.place[3 * size_t(p) + 1], slit.place[3 * size_t(p) + 2]};
}

Point3 cross(const SlitComplex& slit, int a, int b, int c) {
    const Point3 x = at(slit, a), y = at(slit, b), z = at(slit, c);
    Point3 out;
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        out[k] = (y[i] - x[i]) * (z[j] - x[j]) - (y[j] - x[j]) * (z[i] - x[i]);
    }
    return out;
}

double volume(const SlitComplex& slit, const std::array<int, 4>& c) {
    const Point3 n = cross(slit, c[0], c[1], c[2]), x = at(slit, c[0]), y = at(slit, c[3]);
    return ((y[0] - x[0]) * n[0] + (y[1] - x[1]) * n[1] + (y[2] - x[2]) * n[2]) / 6;
}

void check_fits(const SlitComplex& slit) {
    double whole = 0;
    std::map<SlitComplex::Face, int> owners;
    for (const auto& c : slit.corner) {
        CHECK(volume(slit, c) > 0);
        whole += volume(slit, c);
        for (int k = 0; k < 4; k++) {
            SlitComplex::Face face{c[(k + 1) % 4], c[(k + 2) % 4], c[(k + 3) % 4]};
            std::sort(face.begin(), face.end());
            owners[face]++;
        }
    }
    CHECK(whole == doctest::Approx(8).epsilon(1e-12));
    for (const auto& [face, count] : owners) {
        CHECK(count <= 2);
        bool outer = false; // all three on one side of the cube
        for (int d = 0; d < 3; d++)
            for (double side : {0.0, 2.0})
                outer |= std::all_of(face.begin(), face.end(), [&](int p) { return at(slit, p)[d] == side; });
        CHECK(outer == (count == 1));
    }
    for (const auto& [face, normal] : slit.cut) CHECK(owners.at(face) == 2);
}

double passed_area(const SlitComplex& slit) {
    double area = 0;
    for (const auto& [face, normal] : slit.cut) {
        const Point3 n = cross(slit, face[0], face[1], face[2]);
        const double twice = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        CHECK(std::abs(n[0] * normal[0] + n[1] * normal[1] + n[2] * normal[2]) == doctest::Approx(twice));
        area += twice / 2;
    }
    return area;
}

std::vector<BladeTriangle> rectangle(Point3 corner, Point3 u, Point3 v) {
    std::vector<double> x;
    for (int k = 0; k < 4; k++)
        for (int d = 0; d < 3; d++) x.push_back(corner[d] + (k == 1 || k == 2) * u[d] + (k >= 2) * v[d]);
    const int32_t triangle[6] = {0, 1, 2, 0, 2, 3};
    return blade_triangles(x.data(), triangle, 2);
}

} // namespace

TEST_CASE("a blade that ends inside passes as many mm^2 as it has") {
    SlitComplex slit = Cube().complex();
    slit.slit(rectangle({0.31, 0.42, 0.53}, {1.1, 0.2, 0.1}, {-0.1, 0.9, 0.6}));
    const double a[3] = {1.1, 0.2, 0.1}, b[3] = {-0.1, 0.9, 0.6};
    double square = 0;
    for (int k = 0; k < 3; k++) {
        const double c = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
        square += c * c;
    }
    check_fits(slit);
    CHECK(passed_area(slit) == doctest::Approx(std::sqrt(square)).epsilon(1e-9));
}

TEST_CASE("two blades that cross, and one that goes through") {
    SlitComplex slit = Cube().complex();
    slit.slit(rectangle({-0.5, 0.7, -0.5}, {3, 0.4, 0}, {0, 0, 3}));
    const double first = passed_area(slit);
    CHECK(first == doctest::Approx(2 * 2 * std::hypot(3, 0.4) / 3).epsilon(1e-9));
    slit.slit(rectangle({-0.5, -0.5, 1.2}, {3, 0, 0}, {0, 3, 0.3}));
    check_fits(slit);
    CHECK(passed_area(slit) == doctest::Approx(first + 2 * 2 * std::hypot(3, 0.3) / 3).epsilon(1e-9));
}

TEST_CASE("along faces nothing is split, and beside the cube nothing is passed") {
    SlitComplex slit = Cube().complex();
    slit.slit(rectangle({-1, -1, 1}, {4, 0, 0}, {0, 4, 0}));
    CHECK(slit.parent.size() == 48);
    CHECK(passed_area(slit) == doctest::Approx(4));
    slit.slit(rectangle({3, 3, 3}, {4, 0, 0}, {0, 4, 0}));
    CHECK(slit.cut.size() == 8);
}

TEST_CASE("a point lies between the nodes that it came from, and what is passed stays so when it is split") {
    const Cube cube;
    SlitComplex slit = cube.complex();
    slit.slit(rectangle({0.31, 0.42, 0.53}, {1.1, 0.2, 0.1}, {-0.1, 0.9, 0.6}));
    const double area = passed_area(slit);
    const auto face = slit.cut.begin()->first;
    slit.split(face[0], face[1], 0.25);
    check_fits(slit);
    CHECK(passed_area(slit) == doctest::Approx(area).epsilon(1e-12));
    for (size_t p = 0; p < slit.support.size(); p++) {
        const auto& between = slit.support[p];
        double sum = 0, x[3] = {};
        for (int k = 0; k < between.count; k++) {
            CHECK(between.weight[k] > 0);
            sum += between.weight[k];
            for (int d = 0; d < 3; d++) x[d] += between.weight[k] * cube.node[3 * size_t(between.node[k]) + d];
        }
        CHECK(sum == doctest::Approx(1).epsilon(1e-12));
        for (int d = 0; d < 3; d++) CHECK(x[d] == doctest::Approx(at(slit, int(p))[d]).epsilon(1e-12));
    }
}
