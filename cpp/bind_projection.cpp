#include "bind.h"
#include "projector.h"
#include "weights.h"
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
std::pair<std::vector<int64_t>, std::vector<float>> footprint(const Geometry& g, int z, int y, int x) {
    std::map<int64_t, float> found;
    AxisWeights wx, wy;
    for (size_t k = 0; k < g.views.size(); k++) {
        const View& v = g.views[k];
        const int64_t base = int64_t(k) * g.pixels();
        for (int s = 0; s < v.subs; s++) {
            by_voxel(g, v, z, s, Axis::x, wx);
            by_voxel(g, v, z, s, Axis::y, wy);
            for (int i = 0; i < wy.taps; i++)
                for (int j = 0; j < wx.taps; j++) {
                    const float w = wy.weight[size_t(i) * wy.n + y] * wx.weight[size_t(j) * wx.n + x];
                    if (w == 0) continue;
                    const int64_t a = wx.first[x] + j, b = wy.first[y] + i;
                    if (!v.resampled) {
                        const int64_t pixel = v.start + b * v.step_b + a * v.step_a;
                        found[base + pixel] += w * v.path[pixel];
                        continue;
                    }
                    const Sparse& fine = v.resampling.fine;
                    for (int64_t e = fine.offset[b * v.na + a]; e < fine.offset[b * v.na + a + 1]; e++)
                        found[base + fine.index[e]] += w * fine.weight[e] * v.path[fine.index[e]];
                }
        }
    }
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
            "subs", [](const Geometry& g, int view) { return g.views.at(view).subs; }, "view"_a,
            "Sub-slices a slice in a view.")
        .def(
            "resampled", [](const Geometry& g, int view) { return g.views.at(view).resampled; }, "view"_a,
            "Whether the view's panel is tilted, so that it is resampled from a parallel one.")
        .def("footprint", &footprint, "z"_a, "y"_a, "x"_a,
             "Pixels that voxel (z, y, x) touches, numbered over all views, and its weights there, mm.");
    m.def(
        "project", [](const Geometry& g, In<float, 3> f, Array<float, 3> p) { project(g, f.data(), p.data()); },
        "geometry"_a, "f"_a.noconvert(), "p"_a.noconvert(), nb::call_guard<nb::gil_scoped_release>());
    m.def(
        "backproject", [](const Geometry& g, In<float, 3> p, Array<float, 3> f) { backproject(g, p.data(), f.data()); },
        "geometry"_a, "p"_a.noconvert(), "f"_a.noconvert(), nb::call_guard<nb::gil_scoped_release>());
}
