// The factored stiffness of the patch test's cube, whose vertices are its free corners.
#pragma once
#include "compliance/factored_stiffness.h"
#include "patch_test.h"

namespace palpate::patch_test {

// x: positions(). factor: of free_stiffness().
inline FactoredStiffness factored_cube(const SparseCholesky& factor, const std::vector<double>& x) {
    return factored_stiffness(factor.tree, &factor, factor.rounded(), {-1, -1, -1, -1, 0, 1, 2, 3, 4}, {4, 5, 6, 7},
                              x.data());
}

} // namespace palpate::patch_test
