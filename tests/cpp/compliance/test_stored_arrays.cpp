// A push into the cube of the patch test against forces and displacements stored by x86-64.
#include "../factored_cube.h"
#include "../free_stiffness.h"
#include "../stored_arrays.h"
#include "compliance/compliance_model.h"

using namespace palpate;

TEST_CASE("a push by two tools is as stored") {
    const std::vector<double> x = patch_test::positions();
    const SparseCholesky factor(patch_test::free_stiffness(), &x[12]);
    const ComplianceModel model(patch_test::factored_cube(factor, x), 1 << 24);
    ContactPatch patches[2];
    for (int c = 0; c < 2; c++) {
        patches[c].count = 2;
        for (int k = 0; k < 2; k++) patches[c].node[k] = 4 + 2 * c + k, patches[c].weight[k] = k ? 0.3 : 0.7;
    }
    double displacement[6] = {0.4, -0.3, -1.5, -0.2, 0.1, -0.7};
    auto state = model.make_state();
    std::vector<double> force(6), u(3 * patch_test::nodes);
    REQUIRE(model.relax(*state, patches, 2, 0, displacement, 1, force.data()));
    model.displacement(*state, u.data());
    check_stored("push_force", force);
    check_stored("push_displacement", u);
}
