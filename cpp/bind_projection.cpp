#include "bind.h"
#include "finite.h"
#include "footprint.h"
#include "interpolate.h"
#include "projector.h"
#include "shadow.h"
#include "sliding.h"
#include <algorithm>
#include <map>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>
#include <stdexcept>

using namespace nb::literals;
using namespace palpate;

namespace {

Grid grid_of(In<double, 1> shape, In<double, 1> spacing, In<double, 1> origin) {
    return {int(shape(0)), int(shape(1)), int(shape(2)), spacing(0), spacing(1),
            spacing(2),    origin(0),     origin(1),     origin(2)};
}

// The column of A that belongs to one voxel, pixels of all views numbered in order; slow, for tests.
std::pair<std::vector<int64_t>, std::vector<float>> column(const Geometry& g, int z, int y, int x) {
    std::map<int64_t, float> found;
    Footprints footprints(g);
    footprints.prepare(z);
    for (size_t k = 0; k < g.views.size(); k++)
        footprints.visit(int(k), y, x, [&](int64_t pixel, float w) { found[int64_t(k) * g.pixels() + pixel] += w; });
    std::pair<std::vector<int64_t>, std::vector<float>> out;
    for (auto [pixel, w] : found) {
        out.first.push_back(pixel);
        out.second.push_back(w);
    }
    return out;
}

struct Axis {
    In<int32_t, 1> at;
    In<float, 1> share, weight;

    Positions positions(size_t old) const {
        const auto inside = [old](int32_t i) { return i >= 0 && size_t(i) < old; };
        if (share.size() != at.size() || weight.size() != at.size() ||
            !std::all_of(at.data(), at.data() + at.size(), inside))
            throw std::invalid_argument("positions: wrong size or outside");
        return {at.data(), share.data(), weight.data(), int64_t(old), int64_t(at.size())};
    }
};

void interpolate_between(In<float, 3> values, In<int32_t, 1> az, In<float, 1> sz, In<float, 1> wz, In<int32_t, 1> ay,
                         In<float, 1> sy, In<float, 1> wy, In<int32_t, 1> ax, In<float, 1> sx, In<float, 1> wx,
                         Array<float, 3> out) {
    const Positions z = Axis{az, sz, wz}.positions(values.shape(0)), y = Axis{ay, sy, wy}.positions(values.shape(1)),
                    x = Axis{ax, sx, wx}.positions(values.shape(2));
    if (int64_t(out.size()) != z.count * y.count * x.count) throw std::invalid_argument("out: wrong size");
    nb::gil_scoped_release release;
    interpolate(values.data(), z, y, x, out.data());
}

void pass_solids(In<int64_t, 1> first, In<double, 1> attenuation, In<int64_t, 2> ranges, In<int64_t, 1> kind,
                 In<double, 2> solid, In<double, 2> rays, int subrays, Array<double, 2> out) {
    const size_t parts = attenuation.size();
    if (first.size() != parts + 1 || ranges.shape(0) != parts || ranges.shape(1) != 4 ||
        solid.shape(0) != kind.size() || solid.shape(1) != size_t(Solids::numbers) || rays.size() != 12 ||
        size_t(first.data()[parts]) > kind.size() || subrays < 1)
        throw std::invalid_argument("solids: wrong size");
    nb::gil_scoped_release release;
    const double* r = rays.data();
    transmission({first.data(), attenuation.data(), ranges.data(), kind.data(), solid.data(), int64_t(parts)},
                 {r, r + 3, r + 6, r + 9, int64_t(out.shape(0)), int64_t(out.shape(1)), subrays}, out.data());
}

} // namespace

void bind_projection(nb::module_& m) {
    nb::class_<Geometry>(m, "Geometry", "Views and grid as the kernels see them; made once, shared by all of them.")
        .def(
            "__init__",
            [](Geometry* self, In<double, 2> source, In<double, 2> origin, In<double, 2> row_axis,
               In<double, 2> column_axis, In<double, 2> pitch, int rows, int columns, In<double, 1> shape,
               In<double, 1> spacing, In<double, 1> grid_origin, double tolerance) {
                new (self)
                    Geometry(grid_of(shape, spacing, grid_origin), int(source.shape(0)), rows, columns, source.data(),
                             origin.data(), row_axis.data(), column_axis.data(), pitch.data(), tolerance);
            },
            "source"_a, "origin"_a, "row_axis"_a, "column_axis"_a, "pitch"_a, "rows"_a, "columns"_a, "shape"_a,
            "spacing"_a, "grid_origin"_a, "tolerance"_a, nb::call_guard<nb::gil_scoped_release>())
        .def(
            "products",
            [](const Geometry& g, int view, int row) {
                const View& v = g.views.at(view);
                return row < 0 ? products(v) : v.subs * v.moments_of(row);
            },
            "view"_a, "row"_a = -1,
            "Products of 1-D weights a slice in a view, sub-slices times moments: most, or of one row of voxels along "
            "x "
            "(along y where the view sees the two swapped).")
        .def(
            "pose",
            [](const Geometry& g, int view) {
                const Pose pose = g.views.at(view).pose;
                return pose == Pose::parallel ? "parallel" : pose == Pose::turned ? "turned" : "tilted";
            },
            "view"_a, "How the view's panel stands to the slices.")
        .def("column", &column, "z"_a, "y"_a, "x"_a,
             "Pixels that voxel (z, y, x) touches, numbered over all views, and its weights there, mm.");
    m.def("interpolate", &interpolate_between, "values"_a.noconvert(), "z_at"_a.noconvert(), "z_share"_a.noconvert(),
          "z_weight"_a.noconvert(), "y_at"_a.noconvert(), "y_share"_a.noconvert(), "y_weight"_a.noconvert(),
          "x_at"_a.noconvert(), "x_share"_a.noconvert(), "x_weight"_a.noconvert(), "out"_a.noconvert(),
          "Linear along each axis: index below, share of the way to the next, and 1 inside or 0 outside.");
    m.def("transmission", &pass_solids, "first"_a.noconvert(), "attenuation"_a.noconvert(), "ranges"_a.noconvert(),
          "kind"_a.noconvert(), "solid"_a.noconvert(), "rays"_a.noconvert(), "subrays"_a, "out"_a.noconvert(),
          "Mean of e^-p over each pixel's rays through solids; rays: source, first end, down, right.");
    m.def(
        "all_finite", [](In<float, 1> values) { return all_finite(values.data(), int64_t(values.size())); },
        "values"_a.noconvert(), nb::call_guard<nb::gil_scoped_release>(), "Whether none is infinite or not a number.");
    m.def("allow_sliding", &allow_sliding, "whether"_a,
          "Whether the projector may keep sixteen columns in registers where the machine can; for tests.");
    m.def(
        "project", [](const Geometry& g, In<float, 3> f, Array<float, 3> p) { project(g, f.data(), p.data()); },
        "geometry"_a, "f"_a.noconvert(), "p"_a.noconvert(), nb::call_guard<nb::gil_scoped_release>());
    m.def(
        "backproject", [](const Geometry& g, In<float, 3> p, Array<float, 3> f) { backproject(g, p.data(), f.data()); },
        "geometry"_a, "p"_a.noconvert(), "f"_a.noconvert(), nb::call_guard<nb::gil_scoped_release>());
}
