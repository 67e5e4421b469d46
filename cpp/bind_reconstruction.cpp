#include "bind.h"
#include "descent.h"
#include "likelihood.h"
#include "order.h"
#include "prior.h"
#include "subspace.h"
#include <algorithm>
#include <memory>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>
#include <optional>
#include <stdexcept>

using namespace nb::literals;
using namespace palpate;

namespace {

using Spacing = std::array<double, 3>;
template <class T> using Made = nb::ndarray<nb::numpy, T, nb::ndim<3>>;

// A new (n0, n1, n2) float32 array that Python owns.
Made<float> made(const size_t shape[3]) {
    float* data = new float[shape[0] * shape[1] * shape[2]];
    return Made<float>(data, 3, shape, nb::capsule(data, [](void* p) noexcept { delete[] static_cast<float*>(p); }));
}

template <class... Others> void same_size(const In<float, 3>& first, const Others&... others) {
    if (((others.size() != first.size()) || ...)) throw std::invalid_argument("arrays of different sizes");
}

Counts pixels(const In<float, 3>& y, const In<float, 3>& b, const In<float, 3>& r) {
    return {y.data(), b.data(), r.data(), int64_t(y.size())};
}

Made<float> slope_or_curvature(In<float, 3> y, In<float, 3> b, In<float, 3> r, In<float, 3> l, int noise, int kind) {
    same_size(y, b, r, l);
    size_t shape[3] = {y.shape(0), y.shape(1), y.shape(2)};
    Made<float> out = made(shape);
    nb::gil_scoped_release release;
    if (kind < 0)
        transmission_slope(pixels(y, b, r), l.data(), Noise(noise), out.data());
    else
        transmission_curvature(pixels(y, b, r), l.data(), Noise(noise), Curvature(kind), out.data());
    return out;
}

// A prior's potential and neighbours, without its edge; the kernels' table lives as long as this does.
struct Bond {
    Law law;
    int neighbours = 26;
    std::shared_ptr<Table> table;

    explicit Bond(int potential) { law.potential = Potential(potential); }
    Bond(int potential, double exponent, int around, std::optional<In<float, 2>> columns) : Bond(potential) {
        law.exponent = float(exponent);
        neighbours = around;
        if (!columns) return;
        if (columns->shape(0) != 2 || columns->shape(1) != size_t(Table::size))
            throw std::invalid_argument("table: wrong size");
        table = std::make_shared<Table>();
        std::copy_n(columns->data(), Table::size, table->weight);
        std::copy_n(columns->data() + Table::size, Table::size, table->value);
        law.table = table.get();
    }
    Law with(double edge) const {
        if (law.potential == Potential::tabulated && !table) throw std::invalid_argument("table: none given");
        Law made = law;
        made.edge = float(edge);
        return made;
    }
};

Neighbourhood around(const In<float, 3>& f, const Spacing& spacing, const Bond& bond, double edge) {
    int64_t shape[3] = {int64_t(f.shape(0)), int64_t(f.shape(1)), int64_t(f.shape(2))};
    return neighbourhood(shape, spacing.data(), bond.with(edge), bond.neighbours);
}

void bind_likelihood(nb::module_& m) {
    m.def(
        "transmission_value",
        [](In<float, 3> y, In<float, 3> b, In<float, 3> r, In<float, 3> l, int noise) {
            same_size(y, b, r, l);
            nb::gil_scoped_release release;
            return transmission_value(pixels(y, b, r), l.data(), Noise(noise));
        },
        "counts"_a.noconvert(), "incident"_a.noconvert(), "background"_a.noconvert(), "l"_a.noconvert(), "noise"_a);
    m.def(
        "transmission_slope",
        [](In<float, 3> y, In<float, 3> b, In<float, 3> r, In<float, 3> l, int noise) {
            return slope_or_curvature(y, b, r, l, noise, -1);
        },
        "counts"_a.noconvert(), "incident"_a.noconvert(), "background"_a.noconvert(), "l"_a.noconvert(), "noise"_a);
    m.def("transmission_curvature", &slope_or_curvature, "counts"_a.noconvert(), "incident"_a.noconvert(),
          "background"_a.noconvert(), "l"_a.noconvert(), "noise"_a, "kind"_a);
    m.def(
        "transmission_value_and_slope",
        [](In<float, 3> y, In<float, 3> b, In<float, 3> r, In<float, 3> l, int noise, Array<float, 3> slope) {
            same_size(y, b, r, l, slope);
            nb::gil_scoped_release release;
            return transmission_value_and_slope(pixels(y, b, r), l.data(), Noise(noise), slope.data());
        },
        "counts"_a.noconvert(), "incident"_a.noconvert(), "background"_a.noconvert(), "l"_a.noconvert(), "noise"_a,
        "slope"_a.noconvert());
    m.def(
        "least_squares_value",
        [](In<float, 3> weight, In<float, 3> p, In<float, 3> l) {
            same_size(weight, p, l);
            nb::gil_scoped_release release;
            return least_squares_value(weight.data(), p.data(), l.data(), int64_t(l.size()));
        },
        "weights"_a.noconvert(), "line_integrals"_a.noconvert(), "l"_a.noconvert());
}

void bind_prior(nb::module_& m) {
    nb::class_<Bond>(m, "Bond", "Potential and neighbours of a prior, as the kernels take them.")
        .def(nb::init<int>(), "potential"_a)
        .def(nb::init<int, double, int, std::optional<In<float, 2>>>(), "potential"_a, "exponent"_a, "neighbours"_a,
             "table"_a.noconvert() = nb::none());
    nb::implicitly_convertible<int, Bond>();
    m.attr("TABLE_STEPS") = int(Table::steps);
    m.attr("TABLE_OCTAVES") = int(Table::octaves); // below 1, and as many above
    m.def(
        "prior_value",
        [](In<float, 3> f, Spacing spacing, const Bond& potential, double edge) {
            nb::gil_scoped_release release;
            return prior_value(around(f, spacing, potential, edge), f.data());
        },
        "f"_a.noconvert(), "spacing"_a, "potential"_a, "edge"_a);
    m.def(
        "prior_surrogate",
        [](In<float, 3> f, Spacing spacing, const Bond& potential, double edge) {
            size_t shape[3] = {f.shape(0), f.shape(1), f.shape(2)};
            auto answer = std::make_pair(made(shape), made(shape));
            nb::gil_scoped_release release;
            prior_surrogate(around(f, spacing, potential, edge), f.data(), answer.first.data(), answer.second.data());
            return answer;
        },
        "f"_a.noconvert(), "spacing"_a, "potential"_a, "edge"_a);
}

void same_shape(const Geometry& g, const In<float, 3>& pixels) {
    if (int64_t(pixels.size()) != int64_t(g.views.size()) * g.pixels())
        throw std::invalid_argument("pixels: wrong size");
}

void bind_descent(nb::module_& m) {
    nb::class_<Paraboloid>(m, "Paraboloid", "The data's paraboloid as the descent keeps it. Of every view, float32.")
        .def(nb::init<const Geometry&>(), "geometry"_a, nb::keep_alive<1, 2>())
        .def(
            "set_slope",
            [](Paraboloid& data, In<float, 3> slope) {
                same_shape(data.geometry, slope);
                nb::gil_scoped_release release;
                data.set_slope(slope.data());
            },
            "slope"_a.noconvert())
        .def(
            "set_curvature",
            [](Paraboloid& data, In<float, 3> curvature) {
                same_shape(data.geometry, curvature);
                nb::gil_scoped_release release;
                data.set_curvature(curvature.data());
            },
            "curvature"_a.noconvert());
    m.def(
        "descend",
        [](Paraboloid& data, Array<float, 3> f, const Bond& potential, double edge, double beta, double relaxation,
           bool backwards) {
            const Grid& grid = data.geometry.grid;
            const int64_t shape[3] = {grid.nz, grid.ny, grid.nx};
            const double spacing[3] = {grid.dz, grid.dy, grid.dx};
            if (int64_t(f.size()) != shape[0] * shape[1] * shape[2]) throw std::invalid_argument("volume: wrong size");
            nb::gil_scoped_release release;
            descend(neighbourhood(shape, spacing, potential.with(edge), potential.neighbours),
                    {float(beta), float(relaxation), backwards}, data, f.data());
        },
        "data"_a, "f"_a.noconvert(), "potential"_a, "edge"_a, "beta"_a, "relaxation"_a = 1.0, "backwards"_a = false,
        "One sweep of coordinate descent over f, in place. The data's slope follows, to within rounding.");
    m.def(
        "diagonal",
        [](const Geometry& g, In<float, 3> curvature, int every, int every_row) {
            same_shape(g, curvature);
            if (every < 1 || every_row < 1) throw std::invalid_argument("every, every_row: expected 1 or more");
            const size_t shape[3] = {size_t(sampled(g.grid.nz, every)), size_t(sampled(g.grid.ny, every_row)),
                                     size_t(g.grid.nx)};
            Made<float> out = made(shape);
            nb::gil_scoped_release release;
            Paraboloid data(g);
            data.set_curvature(curvature.data());
            diagonal(data, every, every_row, out.data());
            return out;
        },
        "geometry"_a, "curvature"_a.noconvert(), "every"_a = 1, "every_row"_a = 1,
        "Σ_i a_ij² curvature_i of each voxel of every so-many-th slice and row, from the middle of the first so many.");
    m.def(
        "slabs",
        [](const Geometry& g) {
            std::vector<std::array<int, 3>> out;
            for (const Slab& slab : slabs(g)) out.push_back({slab.begin, slab.end, slab.stride});
            return out;
        },
        "geometry"_a, "The descent's slabs: first slice, the one after the last, how far apart rows share no pixel.");
}

using Three = std::array<double, 3>;

void bind_subspace(nb::module_& m) {
    m.def(
        "prior_bends",
        [](In<float, 3> f, In<float, 3> previous, In<float, 3> u, Spacing spacing, const Bond& bond, double edge) {
            same_size(f, previous, u);
            Three bends;
            nb::gil_scoped_release release;
            prior_bends(around(f, spacing, bond, edge), f.data(), previous.data(), u.data(), bends.data());
            return bends;
        },
        "f"_a.noconvert(), "previous"_a.noconvert(), "u"_a.noconvert(), "spacing"_a, "potential"_a, "edge"_a);
    m.def(
        "data_bends",
        [](In<float, 3> curvature, In<float, 3> l, In<float, 3> previous, In<float, 3> q) {
            same_size(curvature, l, previous, q);
            Three bends;
            nb::gil_scoped_release release;
            data_bends(curvature.data(), l.data(), previous.data(), q.data(), int64_t(l.size()), bends.data());
            return bends;
        },
        "curvature"_a.noconvert(), "l"_a.noconvert(), "previous"_a.noconvert(), "q"_a.noconvert());
    m.def(
        "steer",
        [](In<float, 3> f, In<float, 3> previous, Array<float, 3> u, In<float, 3> data, int step, double beta,
           Spacing spacing, const Bond& bond, double edge) {
            same_size(f, previous, u);
            const auto cells = [step](size_t n) { return (n + size_t(step) - 1) / size_t(step); };
            if ((step != 1 && step != coarse_step) || data.shape(0) != f.shape(0) ||
                data.shape(1) != cells(f.shape(1)) || data.shape(2) != cells(f.shape(2)))
                throw std::invalid_argument("data: wrong size");
            std::array<double, 2> slopes;
            nb::gil_scoped_release release;
            steer(around(f, spacing, bond, edge),
                  {data.data(), int64_t(data.shape(1)), int64_t(data.shape(2)), int64_t(step)}, float(beta), f.data(),
                  previous.data(), u.data(), slopes.data());
            return slopes;
        },
        "f"_a.noconvert(), "previous"_a.noconvert(), "u"_a.noconvert(), "data"_a.noconvert(), "step"_a, "beta"_a,
        "spacing"_a, "potential"_a, "edge"_a, "Turns the data's gradient u into the direction, in place.");
    m.attr("COARSE_STEP") = int(coarse_step);
    m.def(
        "advance",
        [](In<float, 3> f, In<float, 3> previous, std::array<double, 2> w, Array<float, 3> u) {
            same_size(f, previous, u);
            nb::gil_scoped_release release;
            advance(f.data(), previous.data(), w.data(), int64_t(f.size()), u.data());
        },
        "f"_a.noconvert(), "previous"_a.noconvert(), "w"_a, "u"_a.noconvert(),
        "Turns u into the next iterate, in place.");
}

} // namespace

void bind_reconstruction(nb::module_& m) {
    bind_likelihood(m);
    bind_prior(m);
    bind_descent(m);
    bind_subspace(m);
}
