#include "bindings/module.h"
#include "projection/footprint_accuracy.h"
#include "projection/projector.h"
#include "projection/separable_passes_avx512.h"
#include "projection/voxel_footprint.h"
#include <algorithm>
#include <map>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

namespace {

constexpr double longest = 1e9;            // mm
constexpr int64_t most_values = 1LL << 40; // of a volume, or of all views

bool finite(const In<double, 2>& a) {
    return std::all_of(a.data(), a.data() + a.size(), [](double v) { return within(v, -longest, longest); });
}

Grid grid_of(In<double, 1> shape, In<double, 1> spacing, In<double, 1> origin) {
    expect(shape.size() == 3 && spacing.size() == 3 && origin.size() == 3, "grid: three numbers each");
    double voxels = 1;
    for (int i = 0; i < 3; i++) {
        expect(within(shape(i), 1.0, 1e6) && within(spacing(i), 1e-9, longest) && within(origin(i), -longest, longest),
               "grid: 1 to 1e6 voxels along an axis, finite spacing and origin");
        voxels *= shape(i);
    }
    expect(voxels < double(most_values), "grid: too many voxels");
    return {int(shape(0)), int(shape(1)), int(shape(2)), spacing(0), spacing(1),
            spacing(2),    origin(0),     origin(1),     origin(2)};
}

// Python says more of a geometry that cannot be; here it is kept from loops without end.
void check_field_of_view(const ScanGeometry& scan) {
    const Grid& g = scan.grid;
    const double top = g.z0 + (g.nz - 0.5) * g.dz, voxel = std::max({g.dz, g.dy, g.dx});
    for (const View& v : scan.views) {
        const Panel& p = v.panel;
        expect(v.source[2] - top >= 0.5 * g.dz, "source: it must lie above the grid, by half a slice at least");
        const double middle = p.origin[2] + 0.5 * (p.rows - 1) * p.dv * p.rows_along[2] +
                              0.5 * (p.columns - 1) * p.du * p.columns_along[2];
        const double reach = (v.source[2] - middle) / (v.source[2] - top);
        expect(reach > 0 && reach * voxel < 1e5 * std::min(p.dv, p.du),
               "pitch: a voxel's shadow has more than 100000 pixels, or the panel lies above the source");
    }
}

// The column of A that belongs to one voxel, pixels of all views numbered in order; slow, for tests.
std::pair<std::vector<int64_t>, std::vector<float>> column(const ScanGeometry& g, int z, int y, int x) {
    expect(z >= 0 && z < g.grid.nz && y >= 0 && y < g.grid.ny && x >= 0 && x < g.grid.nx, "column: no such voxel");
    std::map<int64_t, float> found;
    VoxelFootprint footprints(g);
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

void check_sizes(const ScanGeometry& g, size_t voxels, size_t pixels) {
    expect(voxels == size_t(g.grid.nz * g.grid.slice()), "f: expected the grid's shape");
    expect(pixels == g.views.size() * size_t(g.pixels()), "p: expected (views, rows, columns)");
}

} // namespace

void bind_projection(nb::module_& m) {
    nb::class_<ScanGeometry>(m, "ScanGeometry",
                             "Views and grid as the kernels see them; made once, shared by all of them.")
        .def(
            "__init__",
            [](ScanGeometry* self, In<double, 2> source, In<double, 2> origin, In<double, 2> row_axis,
               In<double, 2> column_axis, In<double, 2> pitch, int rows, int columns, In<double, 1> shape,
               In<double, 1> spacing, In<double, 1> grid_origin, double tolerance, int oversampling) {
                const size_t views = source.shape(0);
                for (const auto* each : {&source, &origin, &row_axis, &column_axis})
                    expect(each->shape(0) == views && each->shape(1) == 3 && finite(*each),
                           "views: expected (views, 3)");
                expect(pitch.shape(0) == views && pitch.shape(1) == 2 && finite(pitch), "pitch: expected (views, 2)");
                expect(std::all_of(pitch.data(), pitch.data() + pitch.size(), [](double p) { return p > 1e-9; }),
                       "pitch: more than 0");
                expect(within(rows, 1, 1'000'000) && within(columns, 1, 1'000'000) && views < 1'000'000 &&
                           double(rows) * columns * double(views) < double(most_values),
                       "rows, columns: 1 to 1000000, and not too many in all");
                expect(within(tolerance, 1e-9, 1e9), "tolerance: more than 0");
                expect(within(oversampling, 1, 16), "oversampling: 1 to 16");
                ScanGeometry made(grid_of(shape, spacing, grid_origin), int(views), rows, columns, source.data(),
                                  origin.data(), row_axis.data(), column_axis.data(), pitch.data(), tolerance,
                                  oversampling);
                check_field_of_view(made);
                choose_subslices(made);
                new (self) ScanGeometry(std::move(made));
            },
            "source"_a, "origin"_a, "row_axis"_a, "column_axis"_a, "pitch"_a, "rows"_a, "columns"_a, "shape"_a,
            "spacing"_a, "grid_origin"_a, "tolerance"_a, "oversampling"_a = 2, nb::call_guard<nb::gil_scoped_release>())
        .def(
            "products",
            [](const ScanGeometry& g, int view, int row) {
                const View& v = g.views.at(view);
                return row < 0 ? products(v) : v.subslices * v.moments_of(row);
            },
            "view"_a, "row"_a = -1,
            "Products of 1-D weights a slice in a view, sub-slices times moments: most, or of one row of voxels along "
            "x "
            "(along y where the view sees the two swapped).")
        .def(
            "orientation",
            [](const ScanGeometry& g, int view) {
                const PanelOrientation orientation = g.views.at(view).orientation;
                return orientation == PanelOrientation::parallel  ? "parallel"
                       : orientation == PanelOrientation::rotated ? "rotated"
                                                                  : "oblique";
            },
            "view"_a, "How the view's panel stands to the slices.")
        .def(
            "slices",
            [](const ScanGeometry& g, int first, int end) {
                expect(0 <= first && first < end && end <= g.grid.nz, "slices: expected some of the grid's");
                return g.slices(first, end);
            },
            "first"_a, "end"_a, "The same rays through some of the slices.")
        .def("column", &column, "z"_a, "y"_a, "x"_a,
             "Pixels that voxel (z, y, x) touches, numbered over all views, and its weights there, mm.");
    m.def("allow_avx512_passes", &allow_avx512_passes, "whether"_a,
          "Whether the projector may keep sixteen columns in registers where the machine can; for tests.");
    m.def(
        "project",
        [](const ScanGeometry& g, In<float, 3> f, Array<float, 3> p, bool add) {
            check_sizes(g, f.size(), p.size());
            project(g, f.data(), p.data(), add);
        },
        "geometry"_a, "f"_as_is, "p"_as_is, "add"_a = false, nb::call_guard<nb::gil_scoped_release>());
    m.def(
        "backproject",
        [](const ScanGeometry& g, In<float, 3> p, Array<float, 3> f) {
            check_sizes(g, f.size(), p.size());
            backproject(g, p.data(), f.data());
        },
        "geometry"_a, "p"_as_is, "f"_as_is, nb::call_guard<nb::gil_scoped_release>());
}
