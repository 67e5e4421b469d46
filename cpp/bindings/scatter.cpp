#include "bindings/arrays.h"
#include "scatter/scatter_image.h"
#include <array>
#include <functional>
#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>

using namespace nb::literals;
using namespace palpate;

namespace {

// The arrays of palpate.scans.scatter.cross_sections, which outlive each call.
Materials materials_of(double log_first, double log_step, const In<double, 3>& attenuation,
                       const In<double, 1>& momentum, const In<double, 2>& form_integral,
                       const In<double, 2>& incoherent_share) {
    const size_t count = attenuation.shape(1), energies = attenuation.shape(2), momenta = momentum.size();
    expect(attenuation.shape(0) == 3 && count >= 1 && energies >= 2, "attenuation: (3, materials, energies)");
    expect(momenta >= 2 && form_integral.shape(0) == count && form_integral.shape(1) == momenta &&
               incoherent_share.shape(0) == count && incoherent_share.shape(1) == momenta,
           "momentum: one value for each column of the two tables");
    expect(std::isfinite(log_first) && log_step > 0, "energies: rise");
    expect_finite(attenuation, "attenuation: finite");
    expect_finite(form_integral, "form_integral: finite");
    expect_finite(incoherent_share, "incoherent_share: finite");
    expect(std::is_sorted(momentum.data(), momentum.data() + momenta) && momentum.data()[0] == 0,
           "momentum: rises from 0");
    for (size_t k = 0; k < count; k++) {
        const double *form = form_integral.data() + k * momenta, *share = incoherent_share.data() + k * momenta;
        expect(std::adjacent_find(form, form + momenta, std::greater_equal<>()) == form + momenta,
               "form_integral: rises");
        expect(*std::max_element(share, share + momenta) > 0.5, "incoherent_share: up to 1");
    }
    const double* a = attenuation.data();
    const size_t table = count * energies;
    expect(std::all_of(a, a + 3 * table, [](double v) { return v >= 0; }), "attenuation: 0 or more");
    expect(*std::min_element(a, a + table) > 0, "photoelectric attenuation: above 0"); // flights are finite
    return {
        int64_t(count),  int64_t(energies),    int64_t(momenta),       log_first, log_step, a, a + table, a + 2 * table,
        momentum.data(), form_integral.data(), incoherent_share.data()};
}

// grid: height, septum, interspace.
AntiscatterGrid grid_of(const double* size, const double* attenuation, int64_t energies) {
    expect(size[0] >= 0 && (size[0] == 0 || (size[1] > 0 && size[2] > 0)), "grid: lengths above 0");
    return {size[0], size[1], size[2], attenuation, attenuation + energies};
}

using Three = std::array<double, 3>;
constexpr double most_far = 1e6; // mm; a photon walks through what is empty

std::tuple<Owned<int64_t, 3>, int64_t, int64_t, int64_t>
image(double log_first, double log_step, In<double, 3> attenuation, In<double, 1> momentum, In<double, 2> form_integral,
      In<double, 2> incoherent_share, In<int64_t, 1> material, In<double, 2> solid, std::array<Three, 2> bounds,
      Three source, std::array<double, 4> field, In<double, 1> keV, In<double, 1> cumulative,
      std::array<double, 4> panel, int64_t rows, int64_t columns, In<double, 1> thickness, Three grid,
      In<double, 2> grid_attenuation, int64_t photons, uint64_t seed) {
    const Materials m = materials_of(log_first, log_step, attenuation, momentum, form_integral, incoherent_share);
    expect_finite(solid, "solid: finite");
    for (const Three& corner : {bounds[0], bounds[1], source})
        for (double v : corner) expect(within(v, -most_far, most_far), "bounds, source: within 1e6 mm");
    for (double v : field) expect(within(v, -most_far, most_far), "field: within 1e6 mm");
    for (double v : panel) expect(within(v, -most_far, most_far), "panel: within 1e6 mm");
    expect(solid.shape(0) == material.size() && solid.shape(1) == size_t(Body::numbers), "solid: (parts, 12)");
    expect_numbers(material, size_t(m.count), "material: the number of one of the materials");
    expect(source[2] > bounds[1][2] && bounds[0][2] >= 0, "the body lies between source and panel");
    expect(keV.size() >= 1 && keV.size() == cumulative.size(), "spectrum: one share for each energy");
    expect(*std::min_element(keV.data(), keV.data() + keV.size()) > 0, "spectrum: energies above 0");
    expect(rows >= 1 && columns >= 1 && panel[2] > 0 && panel[3] > 0, "panel: pixels of some size");
    expect(thickness.size() == 0 || thickness.size() == size_t(m.energies), "thickness: one for each energy");
    expect(grid_attenuation.shape(0) == 2 && grid_attenuation.shape(1) == size_t(m.energies), "grid: (2, energies)");
    expect(photons >= 0, "photons: 0 or more");
    Body body{material.data(), solid.data(), int64_t(material.size()), {}, {}};
    for (size_t i = 0; i < 3; i++) body.low[i] = bounds[0][i], body.high[i] = bounds[1][i];
    const Beam beam{{source[0], source[1], source[2]},
                    {field[0], field[1]},
                    {field[2], field[3]},
                    keV.data(),
                    cumulative.data(),
                    int64_t(keV.size())};
    const FlatPanel flat{
        {panel[0], panel[1]}, {panel[2], panel[3]}, rows, columns, thickness.size() ? thickness.data() : nullptr};
    auto out = zeros<int64_t>(4, rows, columns);
    const AntiscatterGrid septa = grid_of(grid.data(), grid_attenuation.data(), m.energies);
    const Budget b = unlocked([&] { return scatter_image(m, body, beam, flat, septa, photons, seed, out.data()); });
    return {out, b.emitted, b.deposited, b.escaped};
}

auto kernels(double log_first, double log_step, In<double, 3> attenuation, In<double, 1> momentum,
             In<double, 2> form_integral, In<double, 2> incoherent_share, double thickness, double tangent, double keV,
             In<double, 1> gap, In<double, 1> radius, In<double, 2> grids, In<double, 3> grid_attenuation,
             int64_t photons, uint64_t seed) {
    const Materials m = materials_of(log_first, log_step, attenuation, momentum, form_integral, incoherent_share);
    expect(thickness > 0 && keV > 0 && photons >= 0 && std::isfinite(tangent), "thickness, energy: above 0");
    expect(radius.size() >= 2 && std::is_sorted(radius.data(), radius.data() + radius.size()), "radius: rises");
    expect(grids.shape(1) == 3 && grid_attenuation.shape(0) == grids.shape(0) && grid_attenuation.shape(1) == 2 &&
               grid_attenuation.shape(2) == size_t(m.energies),
           "grids: (grids, 3) and their attenuation (grids, 2, energies)");
    std::vector<AntiscatterGrid> septa;
    for (size_t k = 0; k < grids.shape(0); k++)
        septa.push_back(grid_of(grids.data() + 3 * k, grid_attenuation.data() + 2 * k * m.energies, m.energies));
    auto out = zeros<int64_t>(gap.size(), septa.size(), radius.size());
    const PencilPanels panels{gap.data(),   radius.data(),        int64_t(gap.size()), int64_t(radius.size() - 1),
                              septa.data(), int64_t(septa.size())};
    unlocked([&] { return pencil_kernels(m, Pencil{thickness, tangent, keV}, panels, photons, seed, out.data()), 0; });
    return out;
}

// (count, 2): cosine and energy after scattering, for tests.
auto samples(double log_first, double log_step, In<double, 3> attenuation, In<double, 1> momentum,
             In<double, 2> form_integral, In<double, 2> incoherent_share, bool compton, double keV, int64_t count,
             uint64_t seed) {
    const Materials m = materials_of(log_first, log_step, attenuation, momentum, form_integral, incoherent_share);
    expect(keV > 0 && count >= 0, "energy, count: above 0");
    auto out = zeros<double>(count, 2);
    for (int64_t n = 0; n < count; n++) {
        RandomStream random(seed, uint64_t(n));
        const Scattered s = (compton ? scatter_compton : scatter_rayleigh)(m, 0, keV, random);
        out.data()[2 * n] = s.cosine, out.data()[2 * n + 1] = s.keV;
    }
    return out;
}

} // namespace

void bind_scatter(nb::module_& m) {
    m.attr("unit") = Budget::unit;
    m.def("scatter_image", &image, "log_first"_a, "log_step"_a, "attenuation"_as_is, "momentum"_as_is,
          "form_integral"_as_is, "incoherent_share"_as_is, "material"_as_is, "solid"_as_is, "bounds"_a, "source"_a,
          "field"_a, "keV"_as_is, "cumulative"_as_is, "panel"_a, "rows"_a, "columns"_a, "thickness"_as_is, "grid"_a,
          "grid_attenuation"_as_is, "photons"_a, "seed"_a,
          "Energy by order of scattering on a flat panel; then emitted, deposited and escaped energy.");
    m.def("pencil_kernels", &kernels, "log_first"_a, "log_step"_a, "attenuation"_as_is, "momentum"_as_is,
          "form_integral"_as_is, "incoherent_share"_as_is, "thickness"_a, "tangent"_a, "keV"_a, "gap"_as_is,
          "radius"_as_is, "grids"_as_is, "grid_attenuation"_as_is, "photons"_a, "seed"_a,
          "Energy scattered to rings around a pencil beam through a slab: (gaps, grids, rings), then its moment.");
    m.def(
        "grid_transmission",
        [](Three grid, double septum_mu, double interspace_mu, double tangent, double slant) {
            const AntiscatterGrid septa{grid[0], grid[1], grid[2], nullptr, nullptr};
            return grid_transmission(septa, septum_mu, interspace_mu, tangent, slant);
        },
        "grid"_a, "septum_mu"_a, "interspace_mu"_a, "tangent"_a, "slant"_a, "Mean transmission of septa.");
    m.def("samples", &samples, "log_first"_a, "log_step"_a, "attenuation"_as_is, "momentum"_as_is,
          "form_integral"_as_is, "incoherent_share"_as_is, "compton"_a, "keV"_a, "count"_a, "seed"_a,
          "Cosine and energy of photons scattered once, (count, 2).");
}
