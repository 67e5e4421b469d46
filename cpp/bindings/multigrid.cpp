#include "bindings/linalg.h"
#include "bindings/tissue.h"
#include "multigrid/multigrid_model.h"
#include <cmath>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

namespace {

void check_field(const MultigridModel& model, const In<double, 2>& field) {
    if (field.shape(0) != size_t(model.nodes()) || field.shape(1) != 3)
        throw std::invalid_argument("field: expected shape (nodes, 3)");
}

void make(MultigridModel* self, In<double, 2> nodes, In<int32_t, 2> tets, In<double, 1> lam, In<double, 1> mu,
          In<uint8_t, 1> held, double cell, int sweeps, double relaxation, std::optional<In<int32_t, 1>> start,
          std::optional<In<int32_t, 1>> column, std::optional<In<double, 3>> block) {
    const size_t n = nodes.shape(0), m = tets.shape(0);
    if (nodes.shape(1) != 3 || tets.shape(1) != 4 || lam.shape(0) != m || mu.shape(0) != m || held.shape(0) != n)
        throw std::invalid_argument("multigrid: expected nodes (n, 3), tets (m, 4), constants (m,), held (n,)");
    for (size_t k = 0; k < 4 * m; k++)
        if (tets.data()[k] < 0 || size_t(tets.data()[k]) >= n)
            throw std::invalid_argument("multigrid: a tet names a node that is not there");
    if (!(cell > 0) || sweeps < 1 || !(relaxation > 0 && relaxation < 2))
        throw std::invalid_argument("multigrid: cell > 0, sweeps >= 1, 0 < relaxation < 2");
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
    const ElasticMesh mesh{nodes.data(), tets.data(), lam.data(), mu.data(), held.data(), int(n), int(m)};
    if (block)
        new (self) MultigridModel(mesh, K, cell, sweeps, relaxation);
    else
        new (self) MultigridModel(mesh, cell, sweeps, relaxation);
}

Owned<double, 2> internal_force(const MultigridModel& model, In<double, 2> u) {
    check_field(model, u);
    auto out = zeros<double>(model.nodes(), 3);
    nb::gil_scoped_release free;
    model.internal_force(u.data(), out.data());
    return out;
}

Owned<double, 2> precondition(const MultigridModel& model, In<double, 2> v) {
    check_field(model, v);
    auto out = zeros<double>(model.nodes(), 3);
    nb::gil_scoped_release free;
    model.precondition(v.data(), out.data());
    return out;
}

} // namespace

void bind_multigrid(nb::module_& m) {
    nb::class_<MultigridModel, TissueModel>(m, "MultigridModel", "Conjugate gradients with a multigrid preconditioner.")
        .def("__init__", &make, "nodes"_a.noconvert(), "tets"_a.noconvert(), "lam"_a.noconvert(), "mu"_a.noconvert(),
             "held"_a.noconvert(), "cell"_a, "sweeps"_a, "relaxation"_a, "start"_a.noconvert() = nb::none(),
             "column"_a.noconvert() = nb::none(), "block"_a.noconvert() = nb::none(),
             "start, column, block: another stiffness of these nodes, in rows of 3x3 blocks; else that of P1 elements.")
        .def("solve", &solve<MultigridModel>, "state"_a, "patches"_a, "displacement"_a.noconvert(), "iterations"_a,
             "Forces of the tissue on the tools, (contacts, 3) N; None for contacts that cannot be held together.")
        .def("internal_force", &internal_force, "u"_a.noconvert(),
             "K u: (nodes, 3) N that each node needs from outside to stay where it is.")
        .def("precondition", &precondition, "v"_a.noconvert(), "B v: one V-cycle, (nodes, 3).")
        .def_prop_ro("sizes", &MultigridModel::level_sizes, "Nodes of each level, finest first.")
        .def_prop_ro("moved", &MultigridModel::bytes_per_tick,
                     "Bytes that a steady tick of one iteration and one contact moves, caches aside.")
        .def_ro_static("most_contacts", &MultigridModel::most_contacts);
}
