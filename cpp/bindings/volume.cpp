#include "bindings/module.h"
#include "volume/trilinear_resample.h"
#include <stdexcept>

using namespace nb::literals;
using namespace palpate;

namespace {

struct Axis {
    In<int32_t, 1> at;
    In<float, 1> share, weight;

    InterpolationPoints positions(size_t old) const {
        expect(share.size() == at.size() && weight.size() == at.size(), "positions: wrong size");
        expect_numbers(at, old, "positions: outside");
        return {at.data(), share.data(), weight.data(), int64_t(old), int64_t(at.size())};
    }
};

void interpolate_between(In<float, 3> values, In<int32_t, 1> az, In<float, 1> sz, In<float, 1> wz, In<int32_t, 1> ay,
                         In<float, 1> sy, In<float, 1> wy, In<int32_t, 1> ax, In<float, 1> sx, In<float, 1> wx,
                         Array<float, 3> out) {
    const InterpolationPoints z = Axis{az, sz, wz}.positions(values.shape(0)),
                              y = Axis{ay, sy, wy}.positions(values.shape(1)),
                              x = Axis{ax, sx, wx}.positions(values.shape(2));
    if (int64_t(out.size()) != z.count * y.count * x.count) throw std::invalid_argument("out: wrong size");
    nb::gil_scoped_release release;
    interpolate(values.data(), z, y, x, out.data());
}

} // namespace

void bind_volume(nb::module_& m) {
    m.def("interpolate", &interpolate_between, "values"_as_is, "z_at"_as_is, "z_share"_as_is, "z_weight"_as_is,
          "y_at"_as_is, "y_share"_as_is, "y_weight"_as_is, "x_at"_as_is, "x_share"_as_is, "x_weight"_as_is, "out"_as_is,
          "Linear along each axis: index below, share of the way to the next, and 1 inside or 0 outside.");
}
