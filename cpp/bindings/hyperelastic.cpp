#include "bindings/tissue.h"
#include "hyperelastic/hyperelastic_model.h"
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

namespace {

void check_field(const NeoHookean& elements, In<double, 2> u) {
    expect_vectors(u, size_t(elements.nodes()), "displacement: expected shape (nodes, 3)");
}

using Solved = std::optional<std::tuple<Owned<double, 2>, int>>;

Solved solve_steps(const HyperelasticModel& model, ModelState& state, const std::vector<ContactPatch>& patches,
                   In<double, 2> displacement, int steps, double tolerance) {
    check_contacts(model, state, patches, displacement);
    check_count(steps);
    auto force = zeros<double>(patches.size(), 3);
    const int done = unlocked([&] {
        return model.solve(state, patches.data(), int(patches.size()), displacement.data(), steps, tolerance,
                           force.data());
    });
    if (done < 0) return std::nullopt;
    return std::make_tuple(force, done);
}

} // namespace

void bind_hyperelastic(nb::module_& m) {
    nb::class_<NeoHookean>(m, "NeoHookean", "Compressible neo-Hookean tetrahedra at finite strain.")
        .def(
            "__init__",
            [](NeoHookean* self, In<double, 2> nodes, In<int32_t, 2> tets, In<double, 1> lambda, In<double, 1> mu) {
                check_elements(nodes, tets, lambda, mu);
                new (self) NeoHookean(nodes.data(), int(nodes.shape(0)), tets.data(), int(tets.shape(0)), lambda.data(),
                                      mu.data());
            },
            "nodes"_as_is, "tets"_as_is, "lambda_"_as_is, "mu"_as_is)
        .def(
            "energy",
            [](const NeoHookean& e, In<double, 2> u) {
                check_field(e, u);
                auto force = zeros<double>(e.nodes(), 3);
                std::vector<double> ratio(e.padded());
                const auto found = e.energy(u.data(), force.data(), ratio.data());
                return std::make_tuple(found.value, force, found.least);
            },
            "u"_as_is,
            "Energy N mm (infinite where an element is flat or turned), dE/du (nodes, 3) N, least J of the elements.")
        .def(
            "tangent",
            [](const NeoHookean& e, In<double, 2> u, In<double, 2> v) {
                check_field(e, u), check_field(e, v);
                auto out = zeros<double>(e.nodes(), 3);
                e.tangent(u.data(), v.data(), out.data());
                return out;
            },
            "u"_as_is, "v"_as_is, "K(u) v, (nodes, 3) N.");
    nb::class_<HyperelasticModel, TissueModel>(m, "HyperelasticModel",
                                               "Neo-Hookean equilibrium under prescribed patch means.")
        .def(
            "__init__",
            [](HyperelasticModel* self, const NeoHookean& elements, const SparseCholesky& rest, In<int32_t, 1> moving) {
                expect(rest.positive && rest.tree.nodes() == int(moving.size()),
                       "rest: expected positive factors of the nodes `moving`");
                expect_numbers(moving, size_t(elements.nodes()), "moving: no such node");
                new (self) HyperelasticModel(elements, rest, listed(moving));
            },
            "elements"_a, "rest"_a, "moving"_as_is, nb::keep_alive<1, 3>())
        .def("solve", &solve_steps, "state"_a, "patches"_a, "displacement"_as_is, "steps"_a, "tolerance"_a,
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
