#include "bindings/tissue.h"
#include "hyperelastic/hyperelastic_model.h"
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

namespace {

void check_field(const NeoHookean& elements, In<double, 2> u) {
    if (u.shape(0) != size_t(elements.nodes()) || u.shape(1) != 3)
        throw std::invalid_argument("displacement: expected shape (nodes, 3)");
}

NeoHookean made(In<double, 2> nodes, In<int32_t, 2> tets, In<double, 1> lambda, In<double, 1> mu) {
    const size_t count = nodes.shape(0), elements = tets.shape(0);
    if (nodes.shape(1) != 3 || tets.shape(1) != 4 || lambda.shape(0) != elements || mu.shape(0) != elements)
        throw std::invalid_argument("elements: expected (nodes, 3), (elements, 4), and constants of each element");
    for (size_t k = 0; k < 4 * elements; k++)
        if (tets.data()[k] < 0 || size_t(tets.data()[k]) >= count)
            throw std::invalid_argument("tets: names a node that the mesh does not have");
    return NeoHookean(nodes.data(), int(count), tets.data(), int(elements), lambda.data(), mu.data());
}

using Solved = std::optional<std::tuple<Owned<double, 2>, int>>;

Solved solve_steps(const HyperelasticModel& model, ModelState& state, const std::vector<ContactPatch>& patches,
                   In<double, 2> displacement, int steps, double tolerance) {
    check_contacts(model, state, patches, displacement);
    check_count(steps);
    auto force = zeros<double>(patches.size(), 3);
    int done;
    {
        nb::gil_scoped_release free;
        done = model.solve(state, patches.data(), int(patches.size()), displacement.data(), steps, tolerance,
                           force.data());
    }
    if (done < 0) return std::nullopt;
    return std::make_tuple(force, done);
}

} // namespace

void bind_hyperelastic(nb::module_& m) {
    nb::class_<NeoHookean>(m, "NeoHookean", "Compressible neo-Hookean tetrahedra at finite strain.")
        .def(
            "__init__",
            [](NeoHookean* self, In<double, 2> nodes, In<int32_t, 2> tets, In<double, 1> lambda, In<double, 1> mu) {
                new (self) NeoHookean(made(nodes, tets, lambda, mu));
            },
            "nodes"_a.noconvert(), "tets"_a.noconvert(), "lambda_"_a.noconvert(), "mu"_a.noconvert())
        .def(
            "energy",
            [](const NeoHookean& e, In<double, 2> u) {
                check_field(e, u);
                auto force = zeros<double>(e.nodes(), 3);
                std::vector<double> ratio(e.padded());
                const auto found = e.energy(u.data(), force.data(), ratio.data());
                return std::make_tuple(found.value, force, found.least);
            },
            "u"_a.noconvert(),
            "Energy N mm (infinite where an element is flat or turned), dE/du (nodes, 3) N, least J of the elements.")
        .def(
            "tangent",
            [](const NeoHookean& e, In<double, 2> u, In<double, 2> v) {
                check_field(e, u), check_field(e, v);
                auto out = zeros<double>(e.nodes(), 3);
                e.tangent(u.data(), v.data(), out.data());
                return out;
            },
            "u"_a.noconvert(), "v"_a.noconvert(), "K(u) v, (nodes, 3) N.");
    nb::class_<HyperelasticModel, TissueModel>(m, "HyperelasticModel",
                                               "Neo-Hookean equilibrium under prescribed patch means.")
        .def(
            "__init__",
            [](HyperelasticModel* self, const NeoHookean& elements, const SparseCholesky& rest, In<int32_t, 1> moving) {
                std::vector<int> free(moving.data(), moving.data() + moving.shape(0));
                if (!rest.positive || rest.tree.nodes() != int(free.size()))
                    throw std::invalid_argument("rest: expected positive factors of the nodes `moving`");
                for (int i : free)
                    if (i < 0 || i >= elements.nodes()) throw std::invalid_argument("moving: no such node");
                new (self) HyperelasticModel(elements, rest, std::move(free));
            },
            "elements"_a, "rest"_a, "moving"_a.noconvert(), nb::keep_alive<1, 3>())
        .def("solve", &solve_steps, "state"_a, "patches"_a, "displacement"_a.noconvert(), "steps"_a, "tolerance"_a,
             "Forces of the tissue on the tools (contacts, 3) N and the steps taken; None for contacts that cannot be "
             "held together.")
        .def(
            "balance",
            [](const HyperelasticModel& model, const ModelState& state) {
                check_owner(model, state);
                const auto b = model.balance(state);
                return std::make_tuple(b.residual, b.size, b.gap);
            },
            "state"_a, "Residual and size, N mm; gap, mm: how far a tool still has to go.")
        .def_prop_ro("elements", [](const HyperelasticModel& model) { return model.elements; })
        .def_ro_static("most_contacts", &HyperelasticModel::most_contacts);
}
