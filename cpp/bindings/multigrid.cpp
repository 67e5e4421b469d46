#include "bindings/linalg.h"
#include "bindings/tissue.h"
#include "multigrid/multigrid_model.h"
#include <cmath>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

namespace {

void make(MultigridModel* self, In<double, 2> nodes, In<int32_t, 2> tets, In<double, 1> lam, In<double, 1> mu,
          In<uint8_t, 1> held, double cell, int sweeps, double relaxation, std::optional<In<int32_t, 1>> start,
          std::optional<In<int32_t, 1>> column, std::optional<In<double, 3>> block) {
    const size_t n = nodes.shape(0);
    check_elements(nodes, tets, lam, mu);
    expect(held.shape(0) == n, "multigrid: expected held (n,)");
    expect(cell > 0 && sweeps >= 1 && relaxation > 0 && relaxation < 2,
           "multigrid: cell > 0, sweeps >= 1, 0 < relaxation < 2");
    check_count(sweeps);
    expect(n > 0, "multigrid: no nodes");
    for (size_t k = 0; k < nodes.size(); k++)
        expect(std::fabs(nodes.data()[k]) < 1e6 * cell, "multigrid: nodes too far apart for cells of this size");
    expect(start.has_value() == block.has_value() && column.has_value() == block.has_value(),
           "multigrid: start, column and block, or none of them");
    BlockCsr K;
    if (block) {
        K = block_csr(*start, *column, *block);
        expect(size_t(K.nodes()) == n, "multigrid: a matrix of other nodes");
        for (int i = 0; i < K.nodes(); i++)
            expect(std::count(K.column.begin() + K.start[i], K.column.begin() + K.start[i + 1], i) == 1,
                   "multigrid: a row without its diagonal block");
    }
    nb::gil_scoped_release free;
    const ElasticMesh mesh{nodes.data(), tets.data(), lam.data(), mu.data(), held.data(), int(n), int(tets.shape(0))};
    if (block)
        new (self) MultigridModel(mesh, K, cell, sweeps, relaxation);
    else
        new (self) MultigridModel(mesh, cell, sweeps, relaxation);
}

template <void (MultigridModel::*apply)(const double*, double*) const>
Owned<double, 2> applied(const MultigridModel& model, In<double, 2> field) {
    expect_vectors(field, size_t(model.nodes()), "field: expected shape (nodes, 3)");
    auto out = zeros<double>(model.nodes(), 3);
    nb::gil_scoped_release free;
    (model.*apply)(field.data(), out.data());
    return out;
}

} // namespace

void bind_multigrid(nb::module_& m) {
    nb::class_<MultigridModel, TissueModel>(m, "MultigridModel", "Conjugate gradients with a multigrid preconditioner.")
        .def("__init__", &make, "nodes"_as_is, "tets"_as_is, "lam"_as_is, "mu"_as_is, "held"_as_is, "cell"_a,
             "sweeps"_a, "relaxation"_a, "start"_as_is = nb::none(), "column"_as_is = nb::none(),
             "block"_as_is = nb::none(),
             "start, column, block: another stiffness of these nodes, in rows of 3x3 blocks; else that of P1 elements.")
        .def("solve", &solve<MultigridModel>, "state"_a, "patches"_a, "displacement"_as_is, "iterations"_a,
             "Forces of the tissue on the tools, (contacts, 3) N; None for contacts that cannot be held together.")
        .def("internal_force", &applied<&MultigridModel::internal_force>, "u"_as_is,
             "K u: (nodes, 3) N that each node needs from outside to stay where it is.")
        .def("precondition", &applied<&MultigridModel::precondition>, "v"_as_is, "B v: one V-cycle, (nodes, 3).")
        .def_prop_ro("sizes", &MultigridModel::level_sizes, "Nodes of each level, finest first.")
        .def_prop_ro("moved", &MultigridModel::bytes_per_tick,
                     "Bytes that a steady tick of one iteration and one contact moves, caches aside.")
        .def_ro_static("most_contacts", &MultigridModel::most_contacts);
}
