#include "bindings/arrays.h"
#include "elements/smoothed_stiffness.h"
#include <nanobind/stl/tuple.h>
#include <numeric>

using namespace nb::literals;
using namespace palpate;

namespace {

using SparseRows = std::tuple<Owned<int, 1>, Owned<int, 1>, Owned<double, 3>>;

SparseRows stiffness(In<double, 2> nodes, In<int32_t, 2> tets, In<int32_t, 1> region, In<double, 1> filled,
                     In<double, 1> lam, In<double, 1> mu, bool smoothed) {
    const size_t count = tets.shape(0), many = nodes.shape(0);
    expect(nodes.shape(1) == 3 && tets.shape(1) == 4, "expected nodes (n, 3) and tets (m, 4)");
    expect(many < (1u << 30) && count < (1u << 27), "too many nodes or tetrahedra");
    expect(region.size() == count && filled.size() == count && lam.size() == count && mu.size() == count,
           "region, filled, lam, mu: one for each tetrahedron");
    expect_numbers(tets, many, "tets: names a node that is not there");
    expect_finite(nodes, "nodes: not finite");
    std::vector<int> all(many);
    std::iota(all.begin(), all.end(), 0);
    const ElasticSolid solid{nodes.data(), tets.data(), region.data(), lam.data(),
                             mu.data(),    int(many),   int(count),    filled.data()};
    BlockCsr K = unlocked([&] { return smoothed ? smoothed_stiffness(solid, all) : p1_stiffness(solid, all); });
    const size_t blocks = K.column.size();
    return {adopted(std::move(K.start), many + 1), adopted(std::move(K.column), blocks),
            adopted(std::move(K.block), blocks, 3, 3)};
}

} // namespace

void bind_elements(nb::module_& m) {
    m.def("stiffness", &stiffness, "nodes"_as_is, "tets"_as_is, "region"_as_is, "filled"_as_is, "lam"_as_is, "mu"_as_is,
          "smoothed"_a,
          "K of linear elasticity in 3x3 node blocks, N/mm: start (nodes + 1), column and block of compressed sparse "
          "rows. "
          "lam, mu: N/mm^2.");
}
