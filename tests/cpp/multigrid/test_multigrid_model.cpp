#include "../patch_test.h"
#include "multigrid/multigrid_model.h"

using namespace palpate;

TEST_CASE("multigrid passes the patch test") {
    const std::vector<double> x = patch_test::positions();
    const std::vector<int> tet = patch_test::tetrahedra();
    const std::vector<double> lam(patch_test::tets, patch_test::lambda), mu(patch_test::tets, patch_test::mu);
    std::vector<uint8_t> fixed(patch_test::nodes, 0);
    for (int i = 0; i < 4; i++) fixed[i] = 1;
    const MultigridModel model(
        {x.data(), tet.data(), lam.data(), mu.data(), fixed.data(), patch_test::nodes, patch_test::tets},
        patch_test::edge, 2, 1.0);
    patch_test::run_linear(model, 20, 1, 1e-5); // as in the loop: one iteration a tick
    patch_test::run_linear(model, 3, 10, 1e-5);
}
