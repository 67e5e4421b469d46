#include "bind.h"
#include "multigrid.h"
#include <nanobind/stl/optional.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>
#include <stdexcept>

using namespace nb::literals;
using namespace palpate;

namespace {

using Table = nb::ndarray<nb::numpy, double, nb::ndim<2>, nb::c_contig>;

Table table(size_t rows) {
    double* data = new double[3 * rows]();
    return Table(data, {rows, 3}, nb::capsule(data, [](void* p) noexcept { delete[] static_cast<double*>(p); }));
}

void refuse_sizes(const Multigrid& model, const In<double, 2>& field) {
    if (field.shape(0) != size_t(model.nodes()) || field.shape(1) != 3)
        throw std::invalid_argument("field: expected shape (nodes, 3)");
}

void make(Multigrid* self, In<double, 2> nodes, In<int32_t, 2> tets, In<double, 1> lam, In<double, 1> mu,
          In<uint8_t, 1> held, double cell, int sweeps, double relaxation) {
    const size_t n = nodes.shape(0), m = tets.shape(0);
    if (nodes.shape(1) != 3 || tets.shape(1) != 4 || lam.shape(0) != m || mu.shape(0) != m || held.shape(0) != n)
        throw std::invalid_argument("multigrid: expected nodes (n, 3), tets (m, 4), constants (m,), held (n,)");
    for (size_t k = 0; k < 4 * m; k++)
        if (tets.data()[k] < 0 || size_t(tets.data()[k]) >= n)
            throw std::invalid_argument("multigrid: a tet names a node that is not there");
    if (!(cell > 0) || sweeps < 1 || !(relaxation > 0 && relaxation < 2))
        throw std::invalid_argument("multigrid: cell > 0, sweeps >= 1, 0 < relaxation < 2");
    nb::gil_scoped_release free;
    new (self) Multigrid({nodes.data(), tets.data(), lam.data(), mu.data(), held.data(), int(n), int(m)}, cell, sweeps,
                         relaxation);
}

std::optional<Table> solve(const Multigrid& model, State& state, const std::vector<Patch>& patches,
                           In<double, 2> displacement, int iterations) {
    if (!model.owns(state)) throw std::invalid_argument("state: another model's; take one from this model's start()");
    for (const Patch& patch : patches)
        for (int k = 0; k < patch.count; k++)
            if (patch.node[k] < 0 || patch.node[k] >= model.nodes())
                throw std::invalid_argument("patch: names a node that the model does not have");
    if (displacement.shape(0) != patches.size() || displacement.shape(1) != 3)
        throw std::invalid_argument("displacement: expected shape (contacts, 3)");
    auto force = table(patches.size());
    bool done;
    {
        nb::gil_scoped_release free;
        done = model.solve(state, patches.data(), int(patches.size()), displacement.data(), iterations, force.data());
    }
    return done ? std::optional(force) : std::nullopt;
}

Table internal_force(const Multigrid& model, In<double, 2> u) {
    refuse_sizes(model, u);
    auto out = table(model.nodes());
    nb::gil_scoped_release free;
    model.internal_force(u.data(), out.data());
    return out;
}

Table precondition(const Multigrid& model, In<double, 2> v) {
    refuse_sizes(model, v);
    auto out = table(model.nodes());
    nb::gil_scoped_release free;
    model.precondition(v.data(), out.data());
    return out;
}

} // namespace

void bind_multigrid(nb::module_& m) {
    nb::class_<Multigrid, Model>(m, "Multigrid", "Conjugate gradients with a multigrid preconditioner.")
        .def("__init__", &make, "nodes"_a.noconvert(), "tets"_a.noconvert(), "lam"_a.noconvert(), "mu"_a.noconvert(),
             "held"_a.noconvert(), "cell"_a, "sweeps"_a, "relaxation"_a)
        .def("solve", &solve, "state"_a, "patches"_a, "displacement"_a.noconvert(), "iterations"_a,
             "Forces of the tissue on the tools, (contacts, 3) N; None for contacts that cannot be held together.")
        .def("internal_force", &internal_force, "u"_a.noconvert(),
             "K u: (nodes, 3) N that each node needs from outside to stay where it is.")
        .def("precondition", &precondition, "v"_a.noconvert(), "B v: one V-cycle, (nodes, 3).")
        .def_prop_ro("sizes", &Multigrid::sizes, "Nodes of each level, finest first.")
        .def_prop_ro("moved", &Multigrid::moved,
                     "Bytes that a steady tick of one iteration and one contact moves, caches aside.")
        .def_ro_static("most_contacts", &Multigrid::most_contacts);
}
