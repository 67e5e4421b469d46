#include "bindings/tissue.h"
#include "hyperelastic/equilibrium_solver.h"
#include "hyperelastic/neo_hookean.h"
#include "hyperelastic/self_contact.h"
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

void check_stiffening(In<double, 1> stiffening, size_t count) {
    expect(stiffening.size() == count, "stiffening: expected as many as there are shear moduli");
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

// What a tick would know: error, displacement, force, stiffness of the contacts.
using Solution = std::tuple<double, Owned<double, 2>, Owned<double, 2>, Owned<double, 2>>;

std::optional<Solution> solution(EquilibriumSolver& solver, const std::vector<ContactPatch>& patches,
                                 In<double, 2> displacement, bool from_rest) {
    check_nodes(solver.model, patches);
    expect_vectors(displacement, patches.size(), "displacement: expected shape (contacts, 3)");
    expect(within<size_t>(patches.size(), 1, TissueModel::max_patches), "patches: 1 to 4");
    const int count = int(patches.size()), n = 3 * count;
    EquilibriumRequest request;
    request.from_rest = from_rest;
    request.contacts = count;
    for (int c = 0; c < count; c++) request.patch[c].copy(patches[c]);
    std::copy_n(displacement.data(), n, request.displacement);
    EquilibriumAnswer answer = solver.blank();
    unlocked([&] { solver.solve(request, answer); });
    if (!answer.good) return std::nullopt;
    auto realised = zeros<double>(count, 3), force = zeros<double>(count, 3), stiffness = zeros<double>(n, n);
    std::copy_n(answer.local.displacement, n, realised.data());
    for (int k = 0; k < n; k++) force.data()[k] = -solver.response().force[k];
    std::copy_n(solver.response().stiffness.data(), n * n, stiffness.data());
    return std::make_tuple(answer.error, realised, force, stiffness);
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
            "least_volume",
            [](const HyperelasticEnergy& e, In<double, 2> u) {
                check_field(e, u);
                const std::vector<double> ones(e.padded(), 1.0);
                return e.least_ratio(u.data(), ones.data());
            },
            "u"_as_is, "Least J of the elements; negative where one is turned over.")
        .def(
            "tangent",
            [](const HyperelasticEnergy& e, In<double, 2> u, In<double, 2> v) {
                check_field(e, u), check_field(e, v);
                auto out = zeros<double>(e.nodes(), 3);
                std::vector<double> work(e.work_size());
                e.tangent(u.data(), v.data(), 1, out.data(), work.data());
                return out;
            },
            "u"_as_is, "v"_as_is, "K(u) v, (nodes, 3) N.");
    nb::class_<NeoHookean, HyperelasticEnergy>(m, "NeoHookean", "Compressible neo-Hookean tetrahedra at finite strain.")
        .def(
            "__init__",
            [](NeoHookean* self, In<double, 2> nodes, In<int32_t, 2> tets, In<double, 1> lambda, In<double, 1> mu,
               In<double, 1> stiffening) {
                check_elements(nodes, tets, lambda, mu);
                check_stiffening(stiffening, tets.shape(0));
                new (self) NeoHookean(nodes.data(), int(nodes.shape(0)), tets.data(), int(tets.shape(0)), lambda.data(),
                                      mu.data(), stiffening.data());
            },
            "nodes"_as_is, "tets"_as_is, "lambda_"_as_is, "mu"_as_is, "stiffening"_as_is);
    nb::class_<SmoothedNeoHookean, HyperelasticEnergy>(
        m, "SmoothedNeoHookean", "The same law with strain averaged over edges and volume over nodes.")
        .def(
            "__init__",
            [](SmoothedNeoHookean* self, In<double, 2> nodes, In<int32_t, 2> tets, In<double, 1> mu,
               In<int32_t, 2> edge_cell, In<int32_t, 2> node_cell, In<double, 1> edge_mu, In<double, 1> node_lambda,
               In<double, 1> edge_stiffening) {
                check_elements(nodes, tets, mu, mu);
                check_cells(edge_cell, tets.shape(0), 6, edge_mu.shape(0));
                check_cells(node_cell, tets.shape(0), 4, node_lambda.shape(0));
                check_stiffening(edge_stiffening, edge_mu.shape(0));
                const SmoothingCells cells{edge_cell.data(),          node_cell.data(), int(edge_mu.shape(0)),
                                           int(node_lambda.shape(0)), edge_mu.data(),   node_lambda.data(),
                                           edge_stiffening.data()};
                new (self) SmoothedNeoHookean(nodes.data(), int(nodes.shape(0)), tets.data(), int(tets.shape(0)),
                                              mu.data(), cells);
            },
            "nodes"_as_is, "tets"_as_is, "mu"_as_is, "edge_cell"_as_is, "node_cell"_as_is, "edge_mu"_as_is,
            "node_lambda"_as_is, "edge_stiffening"_as_is);
    nb::class_<SelfContact, HyperelasticEnergy>(m, "SelfContact", "Elements whose surface does not go through itself.")
        .def(
            "__init__",
            [](SelfContact* self, const HyperelasticEnergy& elements, const ContactSurface& surface, In<double, 1> mu) {
                expect(mu.size() == size_t(elements.nodes()), "mu: expected one of each node");
                for (int node : surface.node)
                    expect(node < elements.nodes(), "surface: of another mesh than the elements");
                nb::gil_scoped_release free;
                new (self) SelfContact(elements, surface, mu.data());
            },
            "elements"_a, "surface"_a, "mu"_as_is, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
        .def_ro_static("gap", &SelfContact::gap);
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
    nb::class_<LocalForce>(m, "LocalForce", "What finite strain adds to linear contact forces, from one solution.")
        .def(
            "__init__",
            [](LocalForce* self, double energy, In<double, 1> displacement, In<double, 1> gradient,
               In<double, 2> curvature, bool stiffens) {
                const size_t n = displacement.size();
                expect(n % 3 == 0 && n <= LocalForce::most && gradient.size() == n && curvature.shape(0) == n &&
                           curvature.shape(1) == n,
                       "LocalForce: expected 3 numbers a contact, of 4 contacts at most, and a square of them");
                new (self) LocalForce();
                self->contacts = int(n / 3);
                self->energy = energy;
                self->stiffens = stiffens;
                std::copy_n(displacement.data(), n, self->displacement);
                std::copy_n(gradient.data(), n, self->gradient);
                std::copy_n(curvature.data(), n * n, self->curvature);
            },
            "energy"_a, "displacement"_as_is, "gradient"_as_is, "curvature"_as_is, "stiffens"_a = false,
            "At one displacement; mm, N, N mm.")
        .def(
            "at",
            [](const LocalForce& local, In<double, 1> d) {
                expect(d.size() == 3 * size_t(local.contacts), "displacement: expected 3 numbers a contact");
                std::vector<double> out(LocalForce::most, 0.0);
                const double energy = local.add_force(d.data(), out.data());
                return std::make_tuple(energy, copied(out.data(), d.size()));
            },
            "displacement"_as_is, "Energy N mm, and its gradient, N.");
    nb::class_<EquilibriumSolver>(m, "EquilibriumSolver", "Equilibria one after the other, each from the one before.")
        .def(
            "__init__",
            [](EquilibriumSolver* self, const HyperelasticModel& model) { new (self) EquilibriumSolver(model, {}); },
            "model"_a, nb::keep_alive<1, 2>())
        .def("solve", &solution, "patches"_a, "displacement"_as_is, "from_rest"_a = true,
             "The force's error, estimated; displacement (contacts, 3) mm, force (contacts, 3) N on the tools, "
             "stiffness (3 "
             "contacts, 3 contacts) N/mm; None for contacts that cannot be held together.");
}
