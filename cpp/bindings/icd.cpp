#include "bindings/arrays.h"
#include "bindings/statistics.h"
#include "icd/coordinate_descent.h"
#include "icd/sweep_schedule.h"
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

namespace {

void check_size(const ScanGeometry& g, const In<float, 3>& pixels) {
    expect(int64_t(pixels.size()) == int64_t(g.views.size()) * g.pixels(), "pixels: wrong size");
}

template <void (SurrogateImages::*set)(const float*)> void set_image(SurrogateImages& data, In<float, 3> pixels) {
    check_size(data.geometry, pixels);
    nb::gil_scoped_release release;
    (data.*set)(pixels.data());
}

} // namespace

void bind_icd(nb::module_& m) {
    nb::class_<SurrogateImages>(m, "SurrogateImages",
                                "The data's paraboloid as the descent keeps it. Of every view, float32.")
        .def(nb::init<const ScanGeometry&>(), "geometry"_a, nb::keep_alive<1, 2>())
        .def("set_slope", &set_image<&SurrogateImages::set_slope>, "slope"_as_is)
        .def("set_curvature", &set_image<&SurrogateImages::set_curvature>, "curvature"_as_is);
    m.def(
        "sweep",
        [](SurrogateImages& data, Array<float, 3> f, const PriorKernel& potential, double edge, double beta,
           double relaxation, bool backwards, std::optional<In<uint8_t, 3>> support, int first, int end) {
            const Grid& grid = data.geometry.grid;
            const int64_t shape[3] = {grid.nz, grid.ny, grid.nx};
            const Spacing spacing = {grid.dz, grid.dy, grid.dx};
            if (int64_t(f.size()) != shape[0] * shape[1] * shape[2]) throw std::invalid_argument("volume: wrong size");
            if (support) expect(support->size() == f.size(), "support: wrong size");
            nb::gil_scoped_release release;
            const Sweep sweep{float(beta), float(relaxation), backwards, first, end < 0 ? grid.nz : end};
            descend(neighbourhood_of(shape, spacing, potential, edge), sweep, data, f.data(),
                    support ? support->data() : nullptr);
        },
        "data"_a, "f"_as_is, "potential"_a, "edge"_a, "beta"_a, "relaxation"_a = 1.0, "backwards"_a = false,
        "support"_as_is = nb::none(), "first"_a = 0, "end"_a = -1,
        "One sweep of coordinate descent over f, in place. The data's slope follows, to within rounding. f stays 0 "
        "where "
        "support is 0. first, end: the slices that are swept, whole `slabs`; all by default.");
    m.def(
        "diagonal",
        [](const ScanGeometry& g, In<float, 3> curvature, int every, int every_row) {
            check_size(g, curvature);
            if (every < 1 || every_row < 1) throw std::invalid_argument("every, every_row: expected 1 or more");
            auto out = uninitialized<float>(sampled(g.grid.nz, every), sampled(g.grid.ny, every_row), g.grid.nx);
            nb::gil_scoped_release release;
            SurrogateImages data(g);
            data.set_curvature(curvature.data());
            diagonal(data, every, every_row, out.data());
            return out;
        },
        "geometry"_a, "curvature"_as_is, "every"_a = 1, "every_row"_a = 1,
        "Σ_i a_ij² curvature_i of each voxel of every so-many-th slice and row, from the middle of the first so many.");
    m.def(
        "slabs",
        [](const ScanGeometry& g) {
            std::vector<std::array<int, 3>> out;
            for (const Slab& slab : slabs(g)) out.push_back({slab.begin, slab.end, slab.stride});
            return out;
        },
        "geometry"_a, "The descent's slabs: first slice, the one after the last, how far apart rows share no pixel.");
}
