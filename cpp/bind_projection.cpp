#include "bind.h"
#include "finite.h"
#include "footprint.h"
#include "projector.h"
#include <map>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

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
            "products", [](const Geometry& g, int view) { return products(g.views.at(view)); }, "view"_a,
            "Products of 1-D weights a slice in a view: sub-slices times moments.")
        .def(
            "pose",
            [](const Geometry& g, int view) {
                const Pose pose = g.views.at(view).pose;
                return pose == Pose::parallel ? "parallel" : pose == Pose::turned ? "turned" : "tilted";
            },
            "view"_a, "How the view's panel stands to the slices.")
        .def("column", &column, "z"_a, "y"_a, "x"_a,
             "Pixels that voxel (z, y, x) touches, numbered over all views, and its weights there, mm.");
    m.def(
        "all_finite", [](In<float, 1> values) { return all_finite(values.data(), int64_t(values.size())); },
        "values"_a.noconvert(), nb::call_guard<nb::gil_scoped_release>(), "Whether none is infinite or not a number.");
    m.def(
        "project", [](const Geometry& g, In<float, 3> f, Array<float, 3> p) { project(g, f.data(), p.data()); },
        "geometry"_a, "f"_a.noconvert(), "p"_a.noconvert(), nb::call_guard<nb::gil_scoped_release>());
    m.def(
        "backproject", [](const Geometry& g, In<float, 3> p, Array<float, 3> f) { backproject(g, p.data(), f.data()); },
        "geometry"_a, "p"_a.noconvert(), "f"_a.noconvert(), nb::call_guard<nb::gil_scoped_release>());
}
