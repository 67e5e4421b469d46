#include "bindings/linalg.h"
#include "bindings/arrays.h"
#include "linalg/partial_solve.h"
#include "linalg/sparse_cholesky.h"
#include <algorithm>
#include <stdexcept>

using namespace nb::literals;
using namespace palpate;

namespace {

std::vector<int> node_list(const SparseCholesky& factor, In<int32_t, 1> nodes) {
    expect_numbers(nodes, size_t(factor.tree.nodes()), "nodes: one that the matrix does not have");
    std::vector<int> sorted = listed(nodes);
    std::sort(sorted.begin(), sorted.end());
    expect(std::adjacent_find(sorted.begin(), sorted.end()) == sorted.end(), "nodes: one is named twice");
    return listed(nodes);
}

template <class T>
void solve_part(const SparseCholesky& factor, const T* value, const std::vector<int>& nodes, const double* load,
                int columns, const std::vector<int>& wanted, double* out) {
    const int padded = (columns + 7) / 8 * 8;
    PartialSolve<T> partial(factor.tree, value, padded);
    std::vector<T> from(3 * nodes.size() * padded), to(3 * wanted.size() * padded);
    for (size_t i = 0; i < 3 * nodes.size(); i++)
        for (int c = 0; c < columns; c++) from[i * padded + c] = T(load[i * columns + c]);
    partial.solve(nodes.data(), int(nodes.size()), from.data(), wanted.data(), int(wanted.size()), to.data(), columns);
    for (size_t i = 0; i < 3 * wanted.size(); i++)
        for (int c = 0; c < columns; c++) out[i * columns + c] = to[i * padded + c];
}

Owned<double, 2> partial_solve(const SparseCholesky& self, In<int32_t, 1> nodes, In<double, 2> load,
                               In<int32_t, 1> wanted, bool single) {
    if (!self.positive) throw std::invalid_argument("solve: the matrix is not positive definite");
    if (load.shape(0) != 3 * nodes.shape(0) || load.shape(1) == 0)
        throw std::invalid_argument("load: expected shape (3 nodes, columns)");
    const std::vector<int> from = node_list(self, nodes), to = node_list(self, wanted);
    const int columns = int(load.shape(1));
    auto out = uninitialized<double>(3 * to.size(), columns);
    nb::gil_scoped_release free;
    if (single)
        solve_part(self, self.rounded().data(), from, load.data(), columns, to, out.data());
    else
        solve_part(self, self.value.data(), from, load.data(), columns, to, out.data());
    return out;
}

} // namespace

void bind_linalg(nb::module_& m) {
    nb::class_<SparseCholesky>(m, "SparseCholesky", "Sparse factor L of K = L L', K in 3x3 node blocks.")
        .def(
            "__init__",
            [](SparseCholesky* self, In<int32_t, 1> start, In<int32_t, 1> column, In<double, 3> block,
               In<double, 2> places) {
                expect_vectors(places, start.size() - 1, "places: expected (nodes, 3)");
                expect_finite(places, "places: not finite");
                nb::gil_scoped_release free;
                new (self) SparseCholesky(block_csr(start, column, block), places.data());
            },
            "start"_as_is, "column"_as_is, "block"_as_is, "places"_as_is,
            "places: (nodes, 3), anything in which neighbours are near each other.")
        .def_ro("positive", &SparseCholesky::positive, "Every pivot was positive.")
        .def_ro("slack", &SparseCholesky::slack,
                "If positive, K + slack 1 is positive semidefinite, rounding included.")
        .def_prop_ro(
            "entries", [](const SparseCholesky& c) { return c.tree.entry_start.back(); }, "Numbers kept of L.")
        .def_prop_ro(
            "work",
            [](const SparseCholesky& c) {
                double sum = 0;
                for (int s = 0; s < c.tree.count(); s++) sum += c.tree.work(s);
                return sum;
            },
            "Floating-point operations of the factorisation, about.")
        .def(
            "solve",
            [](const SparseCholesky& self, Array<double, 2> x) {
                if (!self.positive) throw std::invalid_argument("solve: the matrix is not positive definite");
                if (x.shape(0) != 3 * size_t(self.tree.nodes())) throw std::invalid_argument("x: one row an unknown");
                nb::gil_scoped_release free;
                if (x.shape(1) > 0) self.solve(x.data(), int(x.shape(1)));
            },
            "x"_as_is, "x (unknowns, columns) becomes K^-1 x.")
        .def("partial_solve", &partial_solve, "nodes"_as_is, "load"_as_is, "wanted"_as_is, "single"_a = false,
             "K^-1 load on the unknowns of `wanted` nodes, load (3 nodes, columns) on those of `nodes`. single: with "
             "the factor in single precision.");
}
