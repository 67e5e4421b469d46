#include "bindings/arrays.h"
#include "cutting/cut_body.h"
#include "cutting/jump_factor.h"

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

// Rows of arrays as a table.
template <class T, class Rows> Owned<T, 2> table(const Rows& rows, int columns) {
    auto out = uninitialized<T>(rows.size(), columns);
    T* to = out.data();
    for (const auto& row : rows) to = std::copy(row.begin(), row.end(), to);
    return out;
}

template <class T, class Values> Owned<T, 1> column(const Values& values) {
    auto out = uninitialized<T>(values.size());
    std::copy(values.begin(), values.end(), out.data());
    return out;
}

nb::dict cut(In<double, 2> nodes, In<int32_t, 2> tets, In<double, 2> points, In<int32_t, 2> triangles) {
    expect(nodes.shape(1) == 3 && tets.shape(1) == 4, "expected nodes (n, 3) and tets (m, 4)");
    expect(tets.shape(0) > 0 && tets.shape(0) < (1u << 27), "tets: none, or too many");
    expect_finite(nodes, "nodes: not finite");
    expect_numbers(tets, nodes.shape(0), "tets: names a node that is not there");
    const std::vector<BladeTriangle> blade = triangles_of(points, triangles);
    const CutBody body = unlocked([&] {
        return cut_body(nodes.data(), int(nodes.shape(0)), tets.data(), int(tets.shape(0)), blade);
    });
    nb::dict out;
    out["tets"] = table<int>(body.mesh.tet, 4);
    out["origin"] = column<int>(body.mesh.origin);
    out["parent"] = column<int>(body.mesh.parent);
    out["share"] = column<double>(body.mesh.share);
    out["side"] = column<int>(body.mesh.side);
    out["body"] = column<int>(body.mesh.body);
    out["triangles"] = table<int>(body.skin.triangle, 3);
    out["lip"] = column<bool>(body.skin.lip);
    out["tet"] = column<int>(body.skin.tet);
    auto weight = uninitialized<double>(body.skin.tet.size(), 4);
    std::copy(body.skin.weight.begin(), body.skin.weight.end(), weight.data());
    out["weight"] = weight;
    return out;
}

} // namespace

void bind_cutting(nb::module_& m) {
    m.def("cut", &cut, "nodes"_as_is, "tets"_as_is, "points"_as_is, "triangles"_as_is,
          "A mesh that the triangles (t, 3) of a blade with points (p, 3) mm have cut, as palpate.meshes.cutting.cut_mesh "
          "has it: tets, origin, parent, share, side, body; of its surface triangles, lip, tet, weight.");
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
