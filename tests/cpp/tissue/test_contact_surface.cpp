#include "tissue/contact_surface.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <doctest.h>
#include <random>

using palpate::ContactPatch;
using palpate::ContactSurface;
using palpate::SurfacePoint;
using Vec = std::array<double, 3>;

namespace {

Vec operator+(Vec a, const Vec& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
Vec operator-(Vec a, const Vec& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Vec operator*(double s, Vec a) { return {s * a[0], s * a[1], s * a[2]}; }
double dot(const Vec& a, const Vec& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
double norm(const Vec& a) { return std::sqrt(dot(a, a)); }
Vec cross(const Vec& a, const Vec& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

struct Mesh {
    std::vector<double> nodes;
    std::vector<int32_t> triangles;
    std::vector<uint8_t> fixed;
    int count() const { return int(nodes.size() / 3); }
    int faces() const { return int(triangles.size() / 3); }
    Vec at(int i) const { return {nodes[3 * i], nodes[3 * i + 1], nodes[3 * i + 2]}; }
    ContactSurface surface() const { return {nodes.data(), count(), triangles.data(), faces(), fixed.data()}; }
};

// A grid of quadrilaterals (each two triangles) at point(i, j), closed in the directions that wrap.
template <class F> Mesh grid(int rows, int columns, bool wrap_rows, bool wrap_columns, F point) {
    Mesh mesh;
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++)
            for (double x : point(i, j)) mesh.nodes.push_back(x);
    for (int i = 0; i < rows - !wrap_rows; i++)
        for (int j = 0; j < columns - !wrap_columns; j++) {
            const int i1 = (i + 1) % rows, j1 = (j + 1) % columns;
            const int a = i * columns + j, b = i1 * columns + j, c = i1 * columns + j1, d = i * columns + j1;
            for (int v : {a, b, c, a, c, d}) mesh.triangles.push_back(v);
        }
    mesh.fixed.assign(mesh.count(), 0);
    return mesh;
}

// A torus with bumps: closed, not convex, triangles of many shapes.
Mesh torus() {
    return grid(30, 17, true, true, [](int i, int j) -> Vec {
        const double a = 2 * M_PI * i / 30, b = 2 * M_PI * j / 17, r = 6 + std::sin(3 * a) + 0.8 * std::cos(4 * b + a);
        return {(20 + r * std::cos(b)) * std::cos(a), (20 + r * std::cos(b)) * std::sin(a), r * std::sin(b)};
    });
}

Mesh plane(int n, double step) {
    return grid(n, n, false, false, [=](int i, int j) -> Vec { return {step * i, step * j, 0}; });
}

double distance_to_segment(const Vec& p, const Vec& a, const Vec& b) {
    const double t = dot(p - a, b - a) / dot(b - a, b - a);
    return norm(p - (a + std::clamp(t, 0.0, 1.0) * (b - a)));
}

// By the projection on the plane if it lies inside, else by the three edges.
double distance_to_triangle(const Vec& p, const Vec& a, const Vec& b, const Vec& c) {
    const Vec n = cross(b - a, c - a);
    const Vec q = p - (dot(p - a, n) / dot(n, n)) * n;
    const bool inside =
        dot(cross(b - a, q - a), n) >= 0 && dot(cross(c - b, q - b), n) >= 0 && dot(cross(a - c, q - c), n) >= 0;
    if (inside) return norm(p - q);
    return std::min({distance_to_segment(p, a, b), distance_to_segment(p, b, c), distance_to_segment(p, c, a)});
}

double distance_to_mesh(const Mesh& mesh, const Vec& p) {
    double least = 1e300;
    for (int t = 0; t < mesh.faces(); t++) {
        const int* v = &mesh.triangles[3 * t];
        least = std::min(least, distance_to_triangle(p, mesh.at(v[0]), mesh.at(v[1]), mesh.at(v[2])));
    }
    return least;
}

void check_closest(const Mesh& mesh, const ContactSurface& surface, const Vec& p) {
    const SurfacePoint found = surface.closest(p.data());
    REQUIRE(found.triangle >= 0);
    CHECK(found.distance == doctest::Approx(distance_to_mesh(mesh, p)).epsilon(1e-10));
    Vec q = {0, 0, 0};
    double sum = 0;
    for (int c = 0; c < 3; c++) {
        CHECK(found.weight[c] >= 0);
        sum += found.weight[c];
        q = q + found.weight[c] * mesh.at(mesh.triangles[3 * found.triangle + c]);
    }
    CHECK(sum == doctest::Approx(1));
    CHECK(norm(q - Vec{found.point[0], found.point[1], found.point[2]}) < 1e-12);
    CHECK(norm(p - q) == doctest::Approx(found.distance).epsilon(1e-10));
}

// The contact patch around the surface point closest to p.
struct Found {
    SurfacePoint at;
    ContactPatch patch;
    ContactSurface::PatchStatus status;
    Found(const ContactSurface& surface, const Vec& p, double radius, bool nodal = false) {
        auto scratch = surface.scratch();
        at = surface.closest(p.data());
        status = nodal ? surface.nodal_patch(at, radius, scratch, patch) : surface.patch(at, radius, scratch, patch);
    }
    double total() const {
        double sum = 0;
        for (int k = 0; k < patch.count; k++) sum += patch.weight[k];
        return sum;
    }
};

} // namespace

TEST_CASE("the closest point equals a search over all triangles") {
    const Mesh mesh = torus();
    const ContactSurface surface = mesh.surface();
    std::mt19937 random(1);
    std::uniform_real_distribution<double> coordinate(-35, 35);
    for (int k = 0; k < 400; k++)
        check_closest(mesh, surface, {coordinate(random), coordinate(random), coordinate(random)});
    std::normal_distribution<double> small(0, 0.5);
    for (int k = 0; k < 400; k++) // near the surface, where many triangles compete
        check_closest(mesh, surface, mesh.at(k) + Vec{small(random), small(random), small(random)});
}

TEST_CASE("one triangle: each of the seven regions around it") {
    Mesh mesh{{0, 0, 0, 4, 0, 0, 1, 3, 0}, {0, 1, 2}, {0, 0, 0}};
    const ContactSurface surface = mesh.surface();
    for (double x = -3; x <= 7; x += 0.25)
        for (double y = -3; y <= 6; y += 0.25) check_closest(mesh, surface, {x, y, 0.5});
}

TEST_CASE("nodes and edge midpoints are at distance zero") {
    const Mesh mesh = torus();
    const ContactSurface surface = mesh.surface();
    for (int t = 0; t < mesh.faces(); t += 7) {
        const Vec a = mesh.at(mesh.triangles[3 * t]), b = mesh.at(mesh.triangles[3 * t + 1]);
        CHECK(surface.closest(a.data()).distance < 1e-12);
        CHECK(surface.closest((0.5 * (a + b)).data()).distance < 1e-12);
    }
}

TEST_CASE("interior nodes of the mesh are no vertices, and the surface keeps the mesh's numbers") {
    Mesh mesh{{9, 9, 9, 0, 0, 0, 4, 0, 0, 9, 9, 9, 1, 3, 0}, {1, 2, 4}, {0, 0, 1, 0, 0}};
    const ContactSurface surface = mesh.surface();
    CHECK(surface.vertices() == 3);
    CHECK(surface.node == std::vector<int>{1, 2, 4});
    CHECK(surface.fixed == std::vector<uint8_t>{0, 1, 0});
    CHECK(surface.area[0] + surface.area[1] + surface.area[2] == doctest::Approx(6)); // 4 * 3 / 2
}

TEST_CASE("a patch of version 0.1 on a plane: weights area (1 - d^2/r^2)^2 over their sum, by hand") {
    const double step = 1, radius = 3.3;
    Mesh mesh = plane(15, step);
    mesh.fixed[7 * 15 + 8] = 1;
    const ContactSurface surface = mesh.surface();
    const Found found(surface, {7.2, 7.4, 1}, radius, true);
    REQUIRE(found.status == ContactSurface::PatchStatus::good);
    std::vector<double> expected(mesh.count(), 0.0);
    double sum = 0;
    for (int i = 0; i < mesh.count(); i++) {
        const double d = norm(mesh.at(i) - Vec{7.2, 7.4, 0});
        if (d >= radius || mesh.fixed[i]) continue;
        expected[i] = std::pow(1 - d * d / (radius * radius), 2); // all areas are equal
        sum += expected[i];
    }
    std::vector<double> weight(mesh.count(), 0.0);
    for (int k = 0; k < found.patch.count; k++) weight[found.patch.node[k]] += found.patch.weight[k];
    for (int i = 0; i < mesh.count(); i++) CHECK(weight[i] == doctest::Approx(expected[i] / sum).epsilon(1e-12));
    CHECK(found.total() == doctest::Approx(1).epsilon(1e-14));
}

TEST_CASE("a patch on a plane: the integrals of the shape functions times (1 - d^2/r^2)^2 by many points") {
    const int n = 12, pieces = 60;
    const double radius = 3.3, centre[2] = {5.2, 5.4};
    const Mesh mesh = plane(n, 1);
    const Found found(mesh.surface(), {centre[0], centre[1], 1}, radius);
    REQUIRE(found.status == ContactSurface::PatchStatus::good);
    std::vector<double> expected(mesh.count(), 0.0), weight(mesh.count(), 0.0);
    double sum = 0, mean[2] = {0, 0};
    for (int t = 0; t < mesh.faces(); t++) // all triangles have the same area
        for (int i = 0; i < pieces; i++)
            for (int j = 0; j < pieces - i; j++) {
                const double a = (i + 1 / 3.0) / pieces, b = (j + 1 / 3.0) / pieces, part[3] = {a, b, 1 - a - b};
                Vec x = {-centre[0], -centre[1], 0};
                for (int c = 0; c < 3; c++) x = x + part[c] * mesh.at(mesh.triangles[3 * t + c]);
                const double f = std::max(0.0, 1 - dot(x, x) / (radius * radius)), phi = f * f;
                for (int c = 0; c < 3; c++) expected[mesh.triangles[3 * t + c]] += phi * part[c], sum += phi * part[c];
            }
    for (int k = 0; k < found.patch.count; k++) weight[found.patch.node[k]] += found.patch.weight[k];
    for (int i = 0; i < mesh.count(); i++) {
        CHECK(weight[i] == doctest::Approx(expected[i] / sum).epsilon(0.02).scale(0.001));
        for (int c = 0; c < 2; c++) mean[c] += weight[i] * mesh.at(i)[c];
    }
    for (int c = 0; c < 2; c++) CHECK(mean[c] == doctest::Approx(centre[c]).epsilon(1e-4)); // a linear field's mean
    CHECK(found.total() == doctest::Approx(1).epsilon(1e-14));
}

TEST_CASE("a patch on the torus: positive weights of sum 1, nodes once each, near the radius, none fixed") {
    Mesh mesh = torus();
    for (int i = 0; i < mesh.count(); i += 5) mesh.fixed[i] = 1;
    const ContactSurface surface = mesh.surface();
    std::mt19937 random(2);
    std::uniform_real_distribution<double> coordinate(-30, 30);
    auto scratch = surface.scratch();
    for (int k = 0; k < 100; k++) {
        const double p[3] = {coordinate(random), coordinate(random), coordinate(random)};
        const SurfacePoint at = surface.closest(p);
        ContactPatch patch, again;
        REQUIRE(surface.patch(at, 7, scratch, patch) == ContactSurface::PatchStatus::good);
        REQUIRE(surface.patch(at, 7, scratch, again) == ContactSurface::PatchStatus::good);
        CHECK(std::equal(patch.node, patch.node + patch.count, again.node));
        double sum = 0;
        std::vector<int> nodes(patch.node, patch.node + patch.count);
        for (int i = 0; i < patch.count; i++) {
            sum += patch.weight[i];
            CHECK(patch.weight[i] > 0);
            CHECK(mesh.fixed[patch.node[i]] == 0);
            CHECK(norm(mesh.at(patch.node[i]) - Vec{at.point[0], at.point[1], at.point[2]}) < 7 + 9); // an edge more
        }
        std::sort(nodes.begin(), nodes.end());
        CHECK(std::adjacent_find(nodes.begin(), nodes.end()) == nodes.end());
        CHECK(sum == doctest::Approx(1).epsilon(1e-14));
    }
}

TEST_CASE("a patch on a thin plate stays on its side") {
    const int n = 12; // a folded sheet: two plates 0.5 mm apart, joined at one edge
    const Mesh mesh = grid(2 * n, n, false, false, [=](int i, int j) -> Vec {
        return i < n ? Vec{double(i), double(j), 0} : Vec{double(2 * n - 1 - i), double(j), 0.5};
    });
    const Found found(mesh.surface(), {8.3, 5.6, -1}, 4);
    REQUIRE(found.status == ContactSurface::PatchStatus::good);
    for (int k = 0; k < found.patch.count; k++) CHECK(found.patch.node[k] < n * n + n); // and the joint's own nodes
}

TEST_CASE("a radius smaller than a triangle gives the barycentric weights") {
    const Mesh mesh = plane(4, 10.0);
    const Found found(mesh.surface(), {14, 12, 3}, 1);
    REQUIRE(found.status == ContactSurface::PatchStatus::good);
    REQUIRE(found.patch.count == 3);
    Vec mean = {0, 0, 0};
    for (int k = 0; k < 3; k++) mean = mean + found.patch.weight[k] * mesh.at(found.patch.node[k]);
    CHECK(norm(mean - Vec{14, 12, 0}) < 1e-12);
}

TEST_CASE("patches that cannot be answered say why") {
    Mesh mesh = plane(30, 1.0);
    CHECK(Found(mesh.surface(), {15, 15, 0}, 12).status == ContactSurface::PatchStatus::too_many_nodes);
    std::fill(mesh.fixed.begin(), mesh.fixed.end(), 1);
    CHECK(Found(mesh.surface(), {15, 15, 0}, 3).status == ContactSurface::PatchStatus::all_fixed);
}

TEST_CASE("the normal is of unit length and close to the sphere's radius") {
    const Mesh mesh = grid(40, 60, false, true, [](int i, int j) -> Vec {
        const double a = M_PI * (i + 0.5) / 40, b = 2 * M_PI * j / 60;
        return {10 * std::sin(a) * std::cos(b), 10 * std::sin(a) * std::sin(b), 10 * std::cos(a)};
    });
    const ContactSurface surface = mesh.surface();
    for (const Vec& p : {Vec{12, 3, 4}, Vec{-2, -9, 3}, Vec{1, 7, -6}}) {
        double n[3];
        surface.normal(surface.closest(p.data()), n);
        const Vec normal = {n[0], n[1], n[2]};
        CHECK(norm(normal) == doctest::Approx(1).epsilon(1e-12));
        CHECK(dot(normal, p) / norm(p) > 0.995);
    }
}
