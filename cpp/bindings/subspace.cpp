#include "bindings/statistics.h"
#include "subspace/memory_gradient.h"
#include <nanobind/stl/array.h>

using namespace nb::literals;
using namespace palpate;

using Three = std::array<double, 3>;

void bind_subspace(nb::module_& m) {
    m.def(
        "prior_curvatures",
        [](In<float, 3> f, In<float, 3> previous, In<float, 3> u, Spacing spacing, const PriorKernel& potential,
           double edge, int first, int end) {
            same_size(f, previous, u);
            const Slices slices = slices_of(f, first, end);
            Three curvatures;
            nb::gil_scoped_release release;
            prior_curvatures(neighbourhood_of(f, spacing, potential, edge), f.data(), previous.data(), u.data(), slices,
                             curvatures.data());
            return curvatures;
        },
        "f"_as_is, "previous"_as_is, "u"_as_is, "spacing"_a, "potential"_a, "edge"_a, "first"_a = 0, "end"_a = -1);
    m.def(
        "data_curvatures",
        [](In<float, 3> curvature, In<float, 3> l, In<float, 3> previous, In<float, 3> q) {
            same_size(curvature, l, previous, q);
            Three curvatures;
            nb::gil_scoped_release release;
            data_curvatures(curvature.data(), l.data(), previous.data(), q.data(), int64_t(l.size()),
                            curvatures.data());
            return curvatures;
        },
        "curvature"_as_is, "l"_as_is, "previous"_as_is, "q"_as_is);
    m.def(
        "search_direction",
        [](In<float, 3> f, In<float, 3> previous, Array<float, 3> u, In<float, 3> data, int step, double beta,
           Spacing spacing, const PriorKernel& potential, double edge, int first, int end) {
            same_size(f, previous, u);
            const Slices slices = slices_of(f, first, end);
            const auto cells = [step](size_t n) { return (n + size_t(step) - 1) / size_t(step); };
            if ((step != 1 && step != coarse_step) || data.shape(0) != f.shape(0) ||
                data.shape(1) != cells(f.shape(1)) || data.shape(2) != cells(f.shape(2)))
                throw std::invalid_argument("data: wrong size");
            std::array<double, 2> slopes;
            nb::gil_scoped_release release;
            search_direction(neighbourhood_of(f, spacing, potential, edge),
                             {data.data(), int64_t(data.shape(1)), int64_t(data.shape(2)), int64_t(step)}, float(beta),
                             f.data(), previous.data(), slices, u.data(), slopes.data());
            return slopes;
        },
        "f"_as_is, "previous"_as_is, "u"_as_is, "data"_as_is, "step"_a, "beta"_a, "spacing"_a, "potential"_a, "edge"_a,
        "first"_a = 0, "end"_a = -1, "Turns the data's gradient u into the direction, in place.");
    m.attr("COARSE_STEP") = int(coarse_step);
    m.def(
        "subspace_step",
        [](In<float, 3> f, In<float, 3> previous, std::array<double, 2> w, Array<float, 3> u) {
            same_size(f, previous, u);
            nb::gil_scoped_release release;
            advance(f.data(), previous.data(), w.data(), int64_t(f.size()), u.data());
        },
        "f"_as_is, "previous"_as_is, "w"_a, "u"_as_is, "Turns u into the next iterate, in place.");
}
