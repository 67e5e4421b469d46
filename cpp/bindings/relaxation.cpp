#include "bindings/linalg.h"
#include "bindings/tissue.h"
#include "relaxation/block_gauss_seidel.h"
#include "relaxation/mass_spring.h"
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

namespace {

const RingRelaxationState& checked(const RingRelaxation& model, const ModelState& state) {
    check_owner(model, state);
    return static_cast<const RingRelaxationState&>(state);
}

void check_forces(const RingRelaxation& model, const ModelState& state, const In<double, 2>& force) {
    expect(force.shape(0) >= size_t(checked(model, state).contacts) && force.shape(1) == 3,
           "force: expected shape (contacts, 3)");
}

} // namespace

void bind_relaxation(nb::module_& m) {
    nb::class_<RingRelaxation, TissueModel>(m, "RingRelaxation")
        .def("solve", &solve<RingRelaxation>, "state"_a, "patches"_a, "displacement"_as_is, "sweeps"_a,
             "Forces of the tissue on the tools, (contacts, 3) N; None for contacts that cannot be held together.")
        .def(
            "internal_force",
            [](const RingRelaxation& model, const ModelState& state) {
                check_owner(model, state);
                auto out = zeros<double>(model.nodes(), 3);
                model.internal_force(state, out.data());
                return out;
            },
            "state"_a, "(nodes, 3) N that each node needs from outside to stay where it is.")
        .def(
            "balance",
            [](const RingRelaxation& model, const ModelState& state, In<double, 2> force) {
                check_forces(model, state, force);
                std::pair<double, double> out;
                model.energy_and_residual(state, force.data(), &out.first, &out.second);
                return out;
            },
            "state"_a, "force"_as_is, "Energy u'Ku/2 and residual r'M^-1 r/2, N mm.")
        .def(
            "residual",
            [](const RingRelaxation& model, const ModelState& state, In<double, 2> force) {
                check_forces(model, state, force);
                auto out = zeros<double>(model.nodes(), 3);
                model.residual(state, force.data(), out.data());
                return out;
            },
            "state"_a, "force"_as_is, "(nodes, 3) N out of balance at the nodes that may move.")
        .def(
            "rows",
            [](const RingRelaxation& model, const ModelState& state) {
                return copied(checked(model, state).rings.ring);
            },
            "state"_a, "Ring of each node, 1 at the contact.")
        .def_ro_static("most_contacts", &RingRelaxation::most_contacts);
    nb::class_<BlockGaussSeidel, RingRelaxation>(m, "BlockGaussSeidel",
                                                 "3x3 blocks of a finite-element operator, relaxed ring by ring.")
        .def(
            "__init__",
            [](BlockGaussSeidel* self, In<int32_t, 1> start, In<int32_t, 1> column, In<double, 3> block,
               In<uint8_t, 1> held, double relaxation, std::optional<In<double, 2>> shape,
               std::optional<In<double, 2>> load) {
                expect(start.size() == held.size() + 1, "held: one for each node");
                const size_t nodes = held.shape(0), size = 3 * nodes * ModeDeflation::count;
                if (shape.has_value() != load.has_value() || (shape && (shape->size() != size || load->size() != size)))
                    throw std::invalid_argument("modes: expected shape and load of (3 nodes, 12), or none");
                new (self)
                    BlockGaussSeidel(block_csr(start, column, block), listed(held), relaxation,
                                     shape ? ModeDeflation(shape->data(), load->data(), int(nodes)) : ModeDeflation());
            },
            "start"_as_is, "column"_as_is, "block"_as_is, "held"_as_is, "relaxation"_a, "shape"_a = nb::none(),
            "load"_a = nb::none())
        .def_ro_static("modes", &ModeDeflation::count);
    nb::class_<MassSpring, RingRelaxation>(m, "MassSpring", "Home and edge springs, relaxed ring by ring.")
        .def(
            "__init__",
            [](MassSpring* self, In<int32_t, 1> start, In<int32_t, 1> column, In<double, 1> stiffness,
               In<double, 2> position, In<uint8_t, 1> held, const std::string& law, double parameter, bool by_distance,
               double edge, double relaxation, bool imposed) {
                const size_t nodes = held.size();
                expect(start.size() == nodes + 1 && position.shape(0) == nodes && position.shape(1) == 3 &&
                           stiffness.size() == column.size(),
                       "springs: expected positions (n, 3), held (n,), and a stiffness of each edge");
                SpringLaw::Kind kind = law == "uniform"  ? SpringLaw::Kind::uniform
                                       : law == "linear" ? SpringLaw::Kind::linear
                                                         : SpringLaw::Kind::exponential;
                new (self) MassSpring(sparsity_pattern(start, column), stiffness.data(), position.data(), listed(held),
                                      {kind, parameter, by_distance, edge}, relaxation, imposed);
            },
            "start"_as_is, "column"_as_is, "stiffness"_as_is, "position"_as_is, "held"_as_is, "law"_a, "parameter"_a,
            "by_distance"_a, "edge"_a, "relaxation"_a, "imposed"_a)
        .def(
            "solve_rows",
            [](const MassSpring& model, ModelState& state, const std::vector<ContactPatch>& patches,
               In<double, 2> displacement, double least, int rows,
               int most_sweeps) -> std::optional<std::tuple<Owned<double, 2>, int, int>> {
                check_contacts(model, state, patches, displacement);
                check_count(most_sweeps);
                expect(least > 0, "least: more than 0 mm");
                auto force = zeros<double>(patches.size(), 3);
                int sweeps = most_sweeps;
                {
                    nb::gil_scoped_release release;
                    rows = model.solve_rows(state, patches.data(), int(patches.size()), displacement.data(), least,
                                            rows, &sweeps, force.data());
                }
                if (rows == 0) return std::nullopt;
                return std::tuple(force, rows, sweeps);
            },
            "state"_a, "patches"_a, "displacement"_as_is, "least"_a, "rows"_a, "most_sweeps"_a,
            "Forces on the tools, rows of the deformed-node index table and sweeps; None as for solve.")
        .def(
            "home",
            [](const MassSpring& model, const ModelState& state) { return copied(checked(model, state).home_spring); },
            "state"_a, "Home spring of each node, N/mm.")
        .def(
            "contraction",
            [](const MassSpring& model, const ModelState& state) {
                return model.eigenvalue_bound(checked(model, state));
            },
            "state"_a, "1 - rho: least eigenvalue bound of diag(K)^-1 K.");
}
