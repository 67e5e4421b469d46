#include "bindings/module.h"
#include "volume/trilinear_resample.h"
#include <algorithm>
#include <stdexcept>

using namespace nb::literals;
using namespace palpate;

namespace {

struct Axis {
    In<int32_t, 1> at;
    In<float, 1> share, weight;

    InterpolationPoints positions(size_t old) const {
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
    const InterpolationPoints z = Axis{az, sz, wz}.positions(values.shape(0)),
                              y = Axis{ay, sy, wy}.positions(values.shape(1)),
                              x = Axis{ax, sx, wx}.positions(values.shape(2));
    if (int64_t(out.size()) != z.count * y.count * x.count) throw std::invalid_argument("out: wrong size");
    nb::gil_scoped_release release;
    interpolate(values.data(), z, y, x, out.data());
}

} // namespace

void bind_volume(nb::module_& m) {
    m.def("interpolate", &interpolate_between, "values"_a.noconvert(), "z_at"_a.noconvert(), "z_share"_a.noconvert(),
          "z_weight"_a.noconvert(), "y_at"_a.noconvert(), "y_share"_a.noconvert(), "y_weight"_a.noconvert(),
          "x_at"_a.noconvert(), "x_share"_a.noconvert(), "x_weight"_a.noconvert(), "out"_a.noconvert(),
          "Linear along each axis: index below, share of the way to the next, and 1 inside or 0 outside.");
}
