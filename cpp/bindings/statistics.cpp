#include "bindings/statistics.h"
#include "bindings/arrays.h"
#include "statistics/panel_blur.h"
#include "statistics/transmission_likelihood.h"
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

using namespace nb::literals;
using namespace palpate;

namespace {

Owned<float, 3> like(const In<float, 3>& a) { return uninitialized<float>(a.shape(0), a.shape(1), a.shape(2)); }

Noise noise_of(int number) {
    expect(number == int(Noise::poisson) || number == int(Noise::gaussian), "noise: 0 or 1");
    return Noise(number);
}

Measurements pixels(const In<float, 3>& y, const In<float, 3>& b, const In<float, 3>& r) {
    return {y.data(), b.data(), r.data(), int64_t(y.size())};
}

Owned<float, 3> slope_or_curvature(In<float, 3> y, In<float, 3> b, In<float, 3> r, In<float, 3> l, int noise,
                                   int kind) {
    same_size(y, b, r, l);
    expect(kind >= -1 && kind <= int(Curvature::maximum), "kind: 0 to 2");
    const Noise law = noise_of(noise);
    auto out = like(y);
    nb::gil_scoped_release release;
    if (kind < 0)
        transmission_slope(pixels(y, b, r), l.data(), law, out.data());
    else
        transmission_curvature(pixels(y, b, r), l.data(), law, Curvature(kind), out.data());
    return out;
}

void bind_likelihood(nb::module_& m) {
    const auto define = [&m](const char* name, auto f, auto... more) {
        m.def(name, f, "counts"_as_is, "incident"_as_is, "background"_as_is, "l"_as_is, "noise"_a, more...);
    };
    define("transmission_value", [](In<float, 3> y, In<float, 3> b, In<float, 3> r, In<float, 3> l, int noise) {
        same_size(y, b, r, l);
        nb::gil_scoped_release release;
        return transmission_value(pixels(y, b, r), l.data(), noise_of(noise));
    });
    define("transmission_slope", [](In<float, 3> y, In<float, 3> b, In<float, 3> r, In<float, 3> l, int noise) {
        return slope_or_curvature(y, b, r, l, noise, -1);
    });
    define("transmission_curvature", &slope_or_curvature, "kind"_a);
    define(
        "transmission_value_and_slope",
        [](In<float, 3> y, In<float, 3> b, In<float, 3> r, In<float, 3> l, int noise, Array<float, 3> slope) {
            same_size(y, b, r, l, slope);
            nb::gil_scoped_release release;
            return transmission_value_and_slope(pixels(y, b, r), l.data(), noise_of(noise), slope.data());
        },
        "slope"_as_is);
    m.def(
        "least_squares_value",
        [](In<float, 3> weight, In<float, 3> p, In<float, 3> l) {
            same_size(weight, p, l);
            nb::gil_scoped_release release;
            return least_squares_value(weight.data(), p.data(), l.data(), int64_t(l.size()));
        },
        "weights"_as_is, "line_integrals"_as_is, "l"_as_is);
}

void bind_prior(nb::module_& m) {
    nb::class_<PriorKernel>(m, "PriorKernel", "Potential and neighbours of a prior, as the kernels take them.")
        .def(nb::init<int>(), "potential"_a)
        .def(nb::init<int, double, int, std::optional<In<float, 2>>>(), "potential"_a, "exponent"_a, "neighbours"_a,
             "table"_as_is = nb::none())
        .def("within", &PriorKernel::within, "outside"_as_is,
             "The same, without pairs of a voxel and one outside the support; outside: Σ ω of those of each voxel.");
    nb::implicitly_convertible<int, PriorKernel>();
    m.attr("TABLE_STEPS") = int(PotentialTable::steps);
    m.attr("TABLE_OCTAVES") = int(PotentialTable::octaves); // below 1, and as many above
    m.def(
        "prior_value",
        [](In<float, 3> f, Spacing spacing, const PriorKernel& potential, double edge, int first, int end) {
            const Slices slices = slices_of(f, first, end);
            nb::gil_scoped_release release;
            return prior_value(neighbourhood_of(f, spacing, potential, edge), f.data(), slices);
        },
        "f"_as_is, "spacing"_a, "potential"_a, "edge"_a, "first"_a = 0, "end"_a = -1,
        "Of pairs of slices first .. end - 1, and of the last of them with the next; all by default.");
    m.def(
        "prior_surrogate",
        [](In<float, 3> f, Spacing spacing, const PriorKernel& potential, double edge) {
            auto answer = std::make_pair(like(f), like(f));
            nb::gil_scoped_release release;
            prior_surrogate(neighbourhood_of(f, spacing, potential, edge), f.data(), answer.first.data(),
                            answer.second.data());
            return answer;
        },
        "f"_as_is, "spacing"_a, "potential"_a, "edge"_a);
}

PanelBlur blur_of(const In<float, 3>& taps, const In<float, 3>& image) {
    expect(taps.shape(0) == image.shape(0) && taps.shape(1) == 2 && taps.shape(2) > 0,
           "taps: (views, 2, reach + 1), one line a view");
    return {taps.data(), int64_t(image.shape(0)), int64_t(image.shape(1)), int64_t(image.shape(2)),
            int64_t(taps.shape(2)) - 1};
}

void bind_blur(nb::module_& m) {
    m.def(
        "blur_views",
        [](In<float, 3> taps, In<float, 3> image) {
            auto out = like(image);
            const PanelBlur blur = blur_of(taps, image);
            nb::gil_scoped_release release;
            blur_views(blur, image.data(), out.data());
            return out;
        },
        "taps"_as_is, "image"_as_is);
    const auto define = [&m](const char* name, auto f, auto... more) {
        m.def(name, f, "counts"_as_is, "incident"_as_is, "background"_as_is, "taps"_as_is, "l"_as_is, more...);
    };
    define("blurred_value", [](In<float, 3> y, In<float, 3> b, In<float, 3> r, In<float, 3> taps, In<float, 3> l) {
        same_size(y, b, r, l);
        const PanelBlur blur = blur_of(taps, l);
        nb::gil_scoped_release release;
        return blurred_value(pixels(y, b, r), blur, l.data(), nullptr);
    });
    define(
        "blurred_value_and_slope",
        [](In<float, 3> y, In<float, 3> b, In<float, 3> r, In<float, 3> taps, In<float, 3> l, Array<float, 3> slope) {
            same_size(y, b, r, l, slope);
            const PanelBlur blur = blur_of(taps, l);
            nb::gil_scoped_release release;
            return blurred_value(pixels(y, b, r), blur, l.data(), slope.data());
        },
        "slope"_as_is);
    m.def(
        "blurred_direction",
        [](In<float, 3> taps, In<float, 3> l, In<float, 3> v) {
            same_size(l, v);
            auto out = like(l);
            const PanelBlur blur = blur_of(taps, l);
            nb::gil_scoped_release release;
            blurred_direction(blur, l.data(), v.data(), out.data());
            return out;
        },
        "taps"_as_is, "l"_as_is, "v"_as_is);
}

} // namespace

void bind_statistics(nb::module_& m) {
    bind_likelihood(m);
    bind_blur(m);
    bind_prior(m);
}
