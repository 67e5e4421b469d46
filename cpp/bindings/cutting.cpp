#include "bindings/arrays.h"
#include "cutting/cut_body.h"
#include "cutting/incision.h"
#include "cutting/jump_factor.h"
#include "cutting/lip_gaps.h"
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

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

template <int columns, class T> std::vector<std::array<int, columns>> rows_of(const In<T, 2>& given) {
    std::vector<std::array<int, columns>> out(given.shape(0));
    for (size_t k = 0; k < out.size(); k++) std::copy_n(given.data() + columns * k, columns, out[k].begin());
    return out;
}

std::tuple<Owned<int, 1>, Owned<int, 2>, Owned<int, 1>> drawn(In<int32_t, 2> triangles, In<uint8_t, 1> lip,
                                                              In<int32_t, 1> rank, int ranks) {
    expect(triangles.shape(1) == 3 && lip.size() == triangles.shape(0), "triangles: (t, 3), lip: (t,)");
    expect(ranks > 0 && ranks < 100000, "ranks: one or more");
    expect_numbers(triangles, rank.size(), "triangles: names a vertex that is not there");
    expect_numbers(rank, size_t(ranks), "rank: one that is not there");
    const DrawnSkin made = drawn_skin(rows_of<3>(triangles), {lip.data(), lip.data() + lip.size()},
                                      {rank.data(), rank.data() + rank.size()}, ranks);
    return {column<int>(made.vertex), table<int>(made.triangle, 3), column<int>(made.lips)};
}

std::vector<Point3> points_of(In<double, 2> path) {
    expect(path.shape(1) == 3 && path.shape(0) > 0, "path: points (p, 3)");
    expect_finite(path, "path: not finite");
    std::vector<Point3> out(path.shape(0));
    for (size_t k = 0; k < out.size(); k++) std::copy_n(path.data() + 3 * k, 3, out[k].begin());
    return out;
}

std::tuple<Owned<double, 2>, std::array<double, 3>> incision_of(const ContactSurface& surface, In<double, 2> path,
                                                                double step, double above,
                                                                std::optional<std::array<double, 3>> direction) {
    const std::vector<Point3> corners = points_of(path);
    expect(step > 0 && above >= 0 && surface.triangles() > 0, "step: above 0 mm; above: 0 mm or more");
    const Incision made = incision(surface, corners, step, above, direction ? direction->data() : nullptr);
    return {table<double>(made.upper, 3), made.way};
}

std::tuple<Owned<int, 1>, Owned<int, 1>, Owned<double, 2>, Owned<double, 2>>
gaps_of_lips(In<int32_t, 2> triangles, In<uint8_t, 1> lip, In<int32_t, 2> carrier, In<double, 2> weight,
             In<double, 2> places, In<int32_t, 1> origin, double same) {
    const size_t vertices = places.shape(0);
    expect(triangles.shape(1) == 3 && lip.size() == triangles.shape(0), "triangles: (t, 3), lip: (t,)");
    expect(carrier.shape(1) == 4 && weight.shape(1) == 4 && places.shape(1) == 3,
           "carrier, weight: (s, 4), places: (s, 3)");
    expect(carrier.shape(0) == vertices && weight.shape(0) == vertices, "carrier, weight: one a vertex");
    expect_numbers(triangles, vertices, "triangles: names a vertex that is not there");
    expect_numbers(carrier, origin.size(), "carrier: names a node that is not there");
    expect_finite(places, "places: not finite");
    expect_finite(weight, "weight: not finite");
    expect(same >= 0, "same: 0 mm or more");
    const LipGaps made = unlocked([&] {
        return lip_gaps({int(vertices), int(lip.size()), triangles.data(), lip.data(), carrier.data(), weight.data(),
                         places.data(), origin.data()},
                        same);
    });
    return {column<int>(made.first), column<int>(made.node), table<double>(made.normal, 3),
            table<double>(made.tangent, 6)};
}

using Ints = Owned<int, 1>;
using CutArrays =
    std::tuple<Owned<int, 2>, Ints, Ints, Owned<double, 1>, Ints, Ints, // tets, origin, parent, share, side, body
               Owned<int, 2>, Owned<bool, 1>, Ints, Owned<double, 2>,   // triangles, lip, tet, weight
               Owned<bool, 1>, Owned<bool, 1>, Ints, Owned<double, 1>>; // real, gone, cut_parent, cut_area

CutArrays cut(In<double, 2> nodes, In<int32_t, 2> tets, In<uint8_t, 1> held, In<double, 2> points,
              In<int32_t, 2> triangles, In<int32_t, 1> sizes) {
    expect(nodes.shape(1) == 3 && tets.shape(1) == 4, "expected nodes (n, 3) and tets (m, 4)");
    expect(tets.shape(0) > 0 && tets.shape(0) < (1u << 27), "tets: none, or too many");
    expect(held.size() == 0 || held.size() == nodes.shape(0), "held: one for each node, or none");
    expect_finite(nodes, "nodes: not finite");
    expect_numbers(tets, nodes.shape(0), "tets: names a node that is not there");
    const std::vector<BladeTriangle> all = triangles_of(points, triangles);
    std::vector<std::vector<BladeTriangle>> cuts;
    size_t at = 0;
    for (size_t k = 0; k < sizes.size(); at += size_t(sizes(k++))) {
        expect(sizes(k) >= 0 && at + size_t(sizes(k)) <= all.size(), "sizes: more triangles than there are");
        cuts.emplace_back(all.begin() + at, all.begin() + at + sizes(k));
    }
    expect(at == all.size(), "sizes: fewer triangles than there are");
    const CutBody body = unlocked([&] {
        return cut_body(nodes.data(), int(nodes.shape(0)), tets.data(), int(tets.shape(0)),
                        held.size() ? held.data() : nullptr, cuts);
    });
    auto weight = uninitialized<double>(body.skin.tet.size(), 4);
    std::copy(body.skin.weight.begin(), body.skin.weight.end(), weight.data());
    return {table<int>(body.mesh.tet, 4),      column<int>(body.mesh.origin),
            column<int>(body.mesh.parent),     column<double>(body.mesh.share),
            column<int>(body.mesh.side),       column<int>(body.mesh.body),
            table<int>(body.skin.triangle, 3), column<bool>(body.skin.lip),
            column<int>(body.skin.tet),        weight,
            column<bool>(body.mesh.real),      column<bool>(body.gone),
            column<int>(body.cut_parent),      column<double>(body.cut_area)};
}

} // namespace

void bind_cutting(nb::module_& m) {
    m.def("cut", &cut, "nodes"_as_is, "tets"_as_is, "held"_as_is, "points"_as_is, "triangles"_as_is, "sizes"_as_is,
          "A mesh that the triangles (t, 3) of a blade with points (p, 3) mm have cut, as "
          "palpate.meshes.cutting.cut_mesh "
          "has it: tets, origin, parent, share, side, body; of its surface triangles, lip, tet, weight; real, of the "
          "nodes; gone, of the "
          "tets; cut_parent and cut_area, mm^2, of the faces that were cut. sizes: triangles of each cut. held: nodes, "
          "1 or 0: a piece that none hold is gone once a cut has freed it; empty: none is.");
    m.def("drawn", &drawn, "triangles"_as_is, "lip"_as_is, "rank"_as_is, "ranks"_a,
          "What a display draws of a cut body's surface: vertices of it (n,), triangles (t, 3) of these, and the first "
          "vertex on lips of each rank (ranks,). rank: of each vertex's region.");
    m.def(
        "straightened",
        [](In<double, 2> path, std::array<double, 3> way) {
            return table<double>(straightened(points_of(path), way.data()), 3);
        },
        "path"_as_is, "way"_a,
        "Points (p, 3) mm of a blade's upper end, moved by a millionth of their way at most, so that parts of "
        "the blade that nearly lie in one plane do.");
    m.def("incision", &incision_of, "surface"_a, "path"_as_is, "step"_a, "above"_a, "direction"_a = nb::none(),
          "The points (p, 3) mm of a blade's upper end that follows a surface, and its way, (0, 0, 0) if it has none.");
    m.def(
        "lip_gaps", &gaps_of_lips, "triangles"_as_is, "lip"_as_is, "carrier"_as_is, "weight"_as_is, "places"_as_is,
        "origin"_as_is, "same"_a,
        "The gaps between lips: first (gaps + 1) and node (entries) of sparse columns, their normals (entries, 3) and "
        "two tangents (entries, 6). same: mm, of vertices at one place.");
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
