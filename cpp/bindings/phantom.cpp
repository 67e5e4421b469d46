#include "bindings/module.h"
#include "phantom/analytic_transmission.h"
#include <algorithm>
#include <stdexcept>

using namespace nb::literals;
using namespace palpate;

namespace {

void transmission_through(In<int64_t, 1> first, In<double, 1> attenuation, In<int64_t, 2> ranges, In<int64_t, 1> kind,
                          In<double, 2> solid, In<double, 2> rays, int subrays, Array<double, 2> out) {
    const size_t parts = attenuation.size();
    if (first.size() != parts + 1 || ranges.shape(0) != parts || ranges.shape(1) != 4 ||
        solid.shape(0) != kind.size() || solid.shape(1) != size_t(Solids::numbers) || rays.size() != 12 ||
        size_t(first.data()[parts]) > kind.size() || subrays < 1)
        throw std::invalid_argument("solids: wrong size");
    expect(first.data()[0] >= 0 && std::is_sorted(first.data(), first.data() + parts + 1), "first: rises from 0");
    expect(subrays <= 1024, "subrays: at most 1024");
    nb::gil_scoped_release release;
    const double* r = rays.data();
    transmission({first.data(), attenuation.data(), ranges.data(), kind.data(), solid.data(), int64_t(parts)},
                 {r, r + 3, r + 6, r + 9, int64_t(out.shape(0)), int64_t(out.shape(1)), subrays}, out.data());
}

} // namespace

void bind_phantom(nb::module_& m) {
    m.def("transmission", &transmission_through, "first"_as_is, "attenuation"_as_is, "ranges"_as_is, "kind"_as_is,
          "solid"_as_is, "rays"_as_is, "subrays"_a, "out"_as_is,
          "Mean of e^-p over each pixel's rays through solids; rays: source, first end, down, right.");
}
