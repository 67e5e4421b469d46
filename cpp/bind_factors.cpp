#include "bind.h"
#include "cholesky.h"
#include "partial.h"
#include <algorithm>
#include <stdexcept>

using namespace nb::literals;
using namespace palpate;

namespace {

void refuse_broken(In<int32_t, 1> start, In<int32_t, 1> column, In<double, 3> block, In<double, 2> places) {
    const size_t nodes = places.shape(0);
    bool good = start.shape(0) == nodes + 1 && block.shape(0) == column.shape(0) && block.shape(1) == 3 &&
                block.shape(2) == 3 && places.shape(1) == 3 && start(0) == 0 && size_t(start(nodes)) == column.shape(0);
    for (size_t i = 0; good && i < nodes; i++) good = start(i) <= start(i + 1);
    for (size_t k = 0; good && k < column.shape(0); k++) good = column(k) >= 0 && size_t(column(k)) < nodes;
    if (!good) throw std::invalid_argument("Cholesky: expected compressed 3x3 block rows and (nodes, 3) places");
}

using Table = nb::ndarray<nb::numpy, double, nb::ndim<2>, nb::c_contig>;

std::vector<int> node_list(const Cholesky& factor, In<int32_t, 1> nodes) {
    std::vector<int> out(nodes.data(), nodes.data() + nodes.shape(0));
    std::vector<int> sorted = out;
    std::sort(sorted.begin(), sorted.end());
    if (!sorted.empty() && (sorted.front() < 0 || sorted.back() >= factor.tree.nodes()))
        throw std::invalid_argument("nodes: one that the matrix does not have");
    if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end())
        throw std::invalid_argument("nodes: one is named twice");
    return out;
}

template <class T>
void solve_part(const Cholesky& factor, const T* value, const std::vector<int>& nodes, const double* load, int columns,
                const std::vector<int>& wanted, double* out) {
    const int padded = (columns + 7) / 8 * 8;
    PartialSolve<T> partial(factor.tree, value, padded);
    std::vector<T> from(3 * nodes.size() * padded), to(3 * wanted.size() * padded);
    for (size_t i = 0; i < 3 * nodes.size(); i++)
        for (int c = 0; c < columns; c++) from[i * padded + c] = T(load[i * columns + c]);
    partial.solve(nodes.data(), int(nodes.size()), from.data(), wanted.data(), int(wanted.size()), to.data(), columns);
    for (size_t i = 0; i < 3 * wanted.size(); i++)
        for (int c = 0; c < columns; c++) out[i * columns + c] = to[i * padded + c];
}

Table part(const Cholesky& self, In<int32_t, 1> nodes, In<double, 2> load, In<int32_t, 1> wanted, bool single) {
    if (!self.positive) throw std::invalid_argument("solve: the matrix is not positive definite");
    if (load.shape(0) != 3 * nodes.shape(0) || load.shape(1) == 0)
        throw std::invalid_argument("load: expected shape (3 nodes, columns)");
    const std::vector<int> from = node_list(self, nodes), to = node_list(self, wanted);
    const int columns = int(load.shape(1));
    double* data = new double[3 * to.size() * columns];
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<double*>(p); });
    {
        nb::gil_scoped_release free;
        if (single) {
            const FactorValues<float> value = self.rounded();
            solve_part(self, value.data(), from, load.data(), columns, to, data);
        } else {
            solve_part(self, self.value.data(), from, load.data(), columns, to, data);
        }
    }
    return Table(data, {3 * to.size(), size_t(columns)}, owner);
}

} // namespace

void bind_factors(nb::module_& m) {
    nb::class_<Cholesky>(m, "Cholesky", "Sparse factor L of K = L L', K in 3x3 node blocks.")
        .def(
            "__init__",
            [](Cholesky* self, In<int32_t, 1> start, In<int32_t, 1> column, In<double, 3> block, In<double, 2> places) {
                refuse_broken(start, column, block, places);
                nb::gil_scoped_release free;
                new (self) Cholesky({{start.data(), column.data(), int(places.shape(0))}, block.data()}, places.data());
            },
            "start"_a.noconvert(), "column"_a.noconvert(), "block"_a.noconvert(), "places"_a.noconvert(),
            "places: (nodes, 3), anything in which neighbours are near each other.")
        .def_ro("positive", &Cholesky::positive, "Every pivot was positive.")
        .def_ro("slack", &Cholesky::slack, "If positive, K + slack 1 is positive semidefinite, rounding included.")
        .def_prop_ro(
            "entries", [](const Cholesky& c) { return c.tree.entry_start.back(); }, "Numbers kept of L.")
        .def_prop_ro("supernodes", [](const Cholesky& c) { return c.tree.count(); })
        .def_prop_ro(
            "work",
            [](const Cholesky& c) {
                double sum = 0;
                for (int s = 0; s < c.tree.count(); s++) sum += c.tree.work(s);
                return sum;
            },
            "Floating-point operations of the factorisation, about.")
        .def(
            "solve",
            [](const Cholesky& self, Array<double, 2> x) {
                if (!self.positive) throw std::invalid_argument("solve: the matrix is not positive definite");
                if (x.shape(0) != 3 * size_t(self.tree.nodes())) throw std::invalid_argument("x: one row an unknown");
                nb::gil_scoped_release free;
                if (x.shape(1) > 0) self.solve(x.data(), int(x.shape(1)));
            },
            "x"_a.noconvert(), "x (unknowns, columns) becomes K^-1 x.")
        .def("solve_part", &part, "nodes"_a.noconvert(), "load"_a.noconvert(), "wanted"_a.noconvert(),
             "single"_a = false,
             "K^-1 load on the unknowns of `wanted` nodes, load (3 nodes, columns) on those of `nodes`. single: with "
             "the factor in single precision.");
}
