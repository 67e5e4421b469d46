#include "bindings/tissue.h"
#include "hyperelastic/hyperelastic_model.h"
#include "hyperelastic/neo_hookean.h"
#include "hyperelastic/smoothed_neo_hookean.h"
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

namespace {

void check_field(const HyperelasticEnergy& elements, In<double, 2> u) {
    expect_vectors(u, size_t(elements.nodes()), "displacement: expected shape (nodes, 3)");
}

void check_cells(In<int32_t, 2> cell, size_t elements, size_t per_tet, size_t cells) {
    expect(cell.shape(0) == elements && cell.shape(1) == per_tet,
           "cells: expected (elements, 6) of edges, (elements, 4) of nodes");
    expect_numbers(cell, cells, "cells: names one that has no constant");
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
    nb::class_<HyperelasticEnergy>(m, "HyperelasticEnergy", "Energy of elements at finite strain.")
        .def(
            "energy",
            [](const HyperelasticEnergy& e, In<double, 2> u) {
                check_field(e, u);
                auto force = zeros<double>(e.nodes(), 3);
                std::vector<double> ratio(e.padded()), work(e.work_size());
                const auto found = e.energy(u.data(), force.data(), ratio.data(), work.data());
                return std::make_tuple(found.value, force, found.least);
            },
            "u"_as_is,
            "Energy N mm (infinite where an element is flat or turned), dE/du (nodes, 3) N, least J of the elements.")
        .def(
            "tangent",
            [](const HyperelasticEnergy& e, In<double, 2> u, In<double, 2> v) {
                check_field(e, u), check_field(e, v);
                auto out = zeros<double>(e.nodes(), 3);
                std::vector<double> work(e.work_size());
                e.tangent(u.data(), v.data(), out.data(), work.data());
                return out;
            },
            "u"_as_is, "v"_as_is, "K(u) v, (nodes, 3) N.");
    nb::class_<NeoHookean, HyperelasticEnergy>(m, "NeoHookean", "Compressible neo-Hookean tetrahedra at finite strain.")
        .def(
            "__init__",
            [](NeoHookean* self, In<double, 2> nodes, In<int32_t, 2> tets, In<double, 1> lambda, In<double, 1> mu) {
                check_elements(nodes, tets, lambda, mu);
                new (self) NeoHookean(nodes.data(), int(nodes.shape(0)), tets.data(), int(tets.shape(0)), lambda.data(),
                                      mu.data());
            },
            "nodes"_as_is, "tets"_as_is, "lambda_"_as_is, "mu"_as_is);
    nb::class_<SmoothedNeoHookean, HyperelasticEnergy>(
        m, "SmoothedNeoHookean", "The same law with strain averaged over edges and volume over nodes.")
        .def(
            "__init__",
            [](SmoothedNeoHookean* self, In<double, 2> nodes, In<int32_t, 2> tets, In<double, 1> mu,
               In<int32_t, 2> edge_cell, In<int32_t, 2> node_cell, In<double, 1> edge_mu, In<double, 1> node_lambda) {
                check_elements(nodes, tets, mu, mu);
                check_cells(edge_cell, tets.shape(0), 6, edge_mu.shape(0));
                check_cells(node_cell, tets.shape(0), 4, node_lambda.shape(0));
                const SmoothingCells cells{edge_cell.data(),          node_cell.data(), int(edge_mu.shape(0)),
                                           int(node_lambda.shape(0)), edge_mu.data(),   node_lambda.data()};
                new (self) SmoothedNeoHookean(nodes.data(), int(nodes.shape(0)), tets.data(), int(tets.shape(0)),
                                              mu.data(), cells);
            },
            "nodes"_as_is, "tets"_as_is, "mu"_as_is, "edge_cell"_as_is, "node_cell"_as_is, "edge_mu"_as_is,
            "node_lambda"_as_is);
    nb::class_<HyperelasticModel, TissueModel>(m, "HyperelasticModel",
                                               "Neo-Hookean equilibrium under prescribed patch means.")
        .def(
            "__init__",
            [](HyperelasticModel* self, const HyperelasticEnergy& elements, const SparseCholesky& rest,
               In<int32_t, 1> moving) {
                expect(rest.positive && rest.tree.nodes() == int(moving.size()),
                       "rest: expected positive factors of the nodes `moving`");
                expect_numbers(moving, size_t(elements.nodes()), "moving: no such node");
                new (self) HyperelasticModel(elements, rest, listed(moving));
            },
            "elements"_a, "rest"_a, "moving"_as_is, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
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
        .def_prop_ro(
            "elements", [](const HyperelasticModel& model) -> const HyperelasticEnergy& { return model.elements; },
            nb::rv_policy::reference_internal)
        .def_ro_static("most_contacts", &HyperelasticModel::most_contacts);
}
