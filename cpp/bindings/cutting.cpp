#include "bindings/arrays.h"
#include "cutting/jump_factor.h"
#include "cutting/slit_complex.h"

using namespace nb::literals;
using namespace palpate;

namespace {

Owned<double, 2> taken(const JumpFactor& factor, In<double, 2> b) {
    expect(b.shape(0) == size_t(factor.size()), "b: one row an unknown");
    auto out = uninitialized<double>(b.shape(0), b.shape(1));
    std::copy_n(b.data(), b.size(), out.data());
    return out;
}

std::vector<BladeTriangle> triangles_of(In<double, 2> points, In<int32_t, 2> triangles) {
    expect(points.shape(1) == 3 && triangles.shape(1) == 3, "blade: expected points (p, 3) and triangles (t, 3)");
    expect_finite(points, "points: not finite");
    expect_numbers(triangles, points.shape(0), "triangles: names a point that is not there");
    return blade_triangles(points.data(), triangles.data(), int(triangles.shape(0)));
}

void expect_mesh(const In<double, 2>& nodes, const In<int32_t, 2>& tets, double near) {
    expect(nodes.shape(1) == 3 && tets.shape(1) == 4, "expected nodes (n, 3) and tets (m, 4)");
    expect_finite(nodes, "nodes: not finite");
    expect_numbers(tets, nodes.shape(0), "tets: names a node that is not there");
    expect(near >= 0, "near: 0 mm or more");
}

// (things, columns), element by element.
template <class T, class Things, class Get> Owned<T, 2> table(const Things& things, int columns, const Get& get) {
    auto out = uninitialized<T>(things.size(), columns);
    T* to = out.data();
    for (const auto& one : things)
        for (int k = 0; k < columns; k++) *to++ = T(get(one, k));
    return out;
}

void bind_slit_complex(nb::module_& m) {
    using Slit = SlitComplex;
    m.def(
        "meets",
        [](In<double, 2> points, In<int32_t, 2> triangles, In<double, 2> nodes, In<int32_t, 2> tets, double near) {
            const std::vector<BladeTriangle> blade = triangles_of(points, triangles);
            expect_mesh(nodes, tets, near);
            auto out = zeros<uint8_t>(tets.shape(0));
            unlocked([&] {
                for (size_t t = 0; t < tets.shape(0); t++) {
                    const double* x[4];
                    for (int k = 0; k < 4; k++) x[k] = nodes.data() + 3 * size_t(tets.data()[4 * t + k]);
                    out.data()[t] = std::any_of(blade.begin(), blade.end(),
                                                [&](const BladeTriangle& one) { return one.meets(x, near); });
                }
            });
            return out;
        },
        "points"_as_is, "triangles"_as_is, "nodes"_as_is, "tets"_as_is, "near"_a,
        "0 for tetrahedra that surely lie more than `near` mm from a blade, (m,).");
    nb::class_<Slit>(
        m, "SlitComplex",
        "Tetrahedra into which those of a mesh are split, and the faces among them that a blade has passed.")
        .def(
            "__init__",
            [](Slit* self, In<double, 2> nodes, In<int32_t, 2> tets, double near) {
                expect_mesh(nodes, tets, near);
                new (self) Slit(nodes.data(), int(nodes.shape(0)), tets.data(), int(tets.shape(0)), near);
            },
            "nodes"_as_is, "tets"_as_is, "near"_a, "near: mm; what lies so near to a plane lies on it.")
        .def(
            "slit",
            [](Slit& self, In<double, 2> points, In<int32_t, 2> triangles) {
                const std::vector<BladeTriangle> blade = triangles_of(points, triangles);
                unlocked([&] { self.slit(blade); });
            },
            "points"_as_is, "triangles"_as_is, "Cuts along a blade, triangles (t, 3) of points (p, 3) mm.")
        .def(
            "split",
            [](Slit& self, int a, int b, double t) {
                const int count = int(self.support.size());
                expect(a >= 0 && a < count && b >= 0 && b < count && self.is_edge(a, b), "a, b: not an edge");
                expect(t > 0 && t < 1, "t: above 0, below 1");
                return self.split(a, b, t);
            },
            "a"_a, "b"_a, "t"_a,
            "The number of a new point at (1 - t) a + t b, which every tetrahedron of that edge gets.")
        .def_prop_ro(
            "places", [](const Slit& s) { return rows(s.place); }, nb::rv_policy::automatic,
            "Of the points, (p, 3) mm.")
        .def_prop_ro(
            "corners", [](const Slit& s) { return table<int>(s.corner, 4, [](auto& c, int k) { return c[k]; }); },
            nb::rv_policy::automatic, "Points of the tetrahedra, (t, 4), positively oriented.")
        .def_prop_ro(
            "parent", [](const Slit& s) { return copied(s.parent); }, nb::rv_policy::automatic,
            "Tetrahedron of the mesh, (t,).")
        .def_prop_ro(
            "between", [](const Slit& s) { return table<int>(s.support, 4, [](auto& p, int k) { return p.node[k]; }); },
            nb::rv_policy::automatic,
            "Nodes of the mesh between which the points lie, (p, 4); -1 where there are fewer.")
        .def_prop_ro(
            "weights",
            [](const Slit& s) { return table<double>(s.support, 4, [](auto& p, int k) { return p.weight[k]; }); },
            nb::rv_policy::automatic, "How much these count, (p, 4).")
        .def_prop_ro(
            "passed", [](const Slit& s) { return table<int>(s.cut, 3, [](auto& c, int k) { return c.first[k]; }); },
            nb::rv_policy::automatic, "Ascending points of the faces that a blade has passed, (f, 3).")
        .def_prop_ro(
            "normals",
            [](const Slit& s) { return table<double>(s.cut, 3, [](auto& c, int k) { return c.second[k]; }); },
            nb::rv_policy::automatic, "The blade's normals there, (f, 3).");
}

} // namespace

void bind_cutting(nb::module_& m) {
    bind_slit_complex(m);
    nb::class_<JumpFactor>(m, "JumpFactor", "The factor M = L S L' of the unknowns of a cut; it grows by rows.")
        .def(
            "__init__",
            [](JumpFactor* self, int capacity) {
                expect(within(capacity, 0, 12000), "capacity: 0 to 12000 unknowns");
                new (self) JumpFactor(capacity);
            },
            "capacity"_a)
        .def_prop_ro("size", &JumpFactor::size, "Unknowns so far.")
        .def(
            "append",
            [](JumpFactor& self, In<double, 2> rows, double sign, double least) {
                expect(rows.shape(0) <= size_t(self.capacity - self.size()), "rows: more than there is room for");
                expect(rows.shape(1) == self.size() + rows.shape(0), "rows: expected (new, all with the new)");
                expect((sign == 1 || sign == -1) && least >= 0, "sign: 1 or -1; least: 0 or more");
                return unlocked([&] { return self.append(rows.data(), int(rows.shape(0)), sign, least); });
            },
            "rows"_as_is, "sign"_a, "least"_a,
            "Rows of M's lower triangle; False, and none, if a pivot all but vanishes.")
        .def(
            "reduce",
            [](const JumpFactor& self, In<double, 2> b) {
                auto out = taken(self, b);
                unlocked([&] { self.reduce(out.data(), int(out.shape(1)), 0); });
                return out;
            },
            "b"_as_is, "z = L^-1 b, (unknowns, columns).")
        .def(
            "expand",
            [](const JumpFactor& self, In<double, 2> z) {
                auto out = taken(self, z);
                unlocked([&] { self.expand(out.data(), int(out.shape(1))); });
                return out;
            },
            "z"_as_is, "x = L^-T S z, so that M x = b.")
        .def(
            "blocks",
            [](const JumpFactor& self, In<double, 3> z, In<double, 3> w) {
                const size_t n = size_t(self.size());
                expect(z.shape(1) == 3 && w.shape(1) == 3 && z.shape(2) == n && w.shape(2) == n,
                       "z, w: expected (loads, 3, unknowns)");
                expect(z.shape(0) == w.shape(0), "z, w: as many loads");
                auto out = zeros<double>(z.shape(0), 3, 3);
                unlocked([&] {
                    for (size_t k = 0; k < z.shape(0); k++)
                        self.block(z.data() + 3 * n * k, w.data() + 3 * n * k, int(n), out.data() + 9 * k);
                });
                return out;
            },
            "z"_as_is, "w"_as_is, "The sum of s z w', (loads, 3, 3), of pairs of loads.");
}
