#include "../free_stiffness.h"
#include "hyperelastic/hyperelastic_model.h"
#include "hyperelastic/neo_hookean.h"
#include <cmath>

using namespace palpate;

namespace {

struct Cube : patch_test::Mesh {
    NeoHookean elements(double stiffening = 0) const {
        const std::vector<double> b(patch_test::tets, stiffening);
        return {x.data(), patch_test::nodes, tet.data(), patch_test::tets, lambda_of.data(), mu_of.data(), b.data()};
    }
};

} // namespace

// F = 1 + slope (x) e_z is constant, J = 1 + slope_z, F^-T e_z = e_z / J; the top's traction is P e_z with
// P = mu (F - F^-T) + lambda ln J F^-T, the derivative of mu/2 (tr F'F - 3) - mu ln J + lambda/2 (ln J)^2. With a
// stiffening b, mu grows by exp(b S), S = tr F'F - 3 - 2 ln J and tr F'F - 3 = |slope|^2 + 2 slope_z.
TEST_CASE("the neo-Hookean model passes the patch test at large strain, with stiffening too") {
    const Cube cube;
    const SparseCholesky rest(patch_test::free_stiffness(), &cube.x[12]);
    const double slope[3] = {0.4, -0.3, -0.35}, J = 1 + slope[2];
    const double square = slope[0] * slope[0] + slope[1] * slope[1] + slope[2] * slope[2];
    for (double b : {0.0, 1.0, 4.0}) {
        const NeoHookean elements = cube.elements(b);
        const HyperelasticModel model(elements, rest, {4, 5, 6, 7, 8});
        const double lambda = patch_test::lambda;
        const double mu = patch_test::mu * std::exp(b * (square + 2 * slope[2] - 2 * std::log(J)));
        const double traction[3] = {mu * slope[0], mu * slope[1], mu * (J - 1 / J) + lambda * std::log(J) / J};
        patch_test::run(model, slope, traction, 5, 100, 1e-6);
    }
}

TEST_CASE("force is the energy's gradient, the tangent its derivative: central differences") {
    const Cube cube;
    const NeoHookean elements = cube.elements();
    const int n = 3 * patch_test::nodes;
    std::vector<double> u(n), v(n), force(n), tangent(n), ratio(elements.padded()), ignored(n);
    for (int i = 0; i < n; i++) u[i] = 0.8 * std::sin(3.0 * i), v[i] = std::cos(5.0 * i);
    const NeoHookean::Energy at = elements.energy(u.data(), force.data(), ratio.data());
    REQUIRE(std::isfinite(at.value));
    elements.tangent(u.data(), v.data(), 1, tangent.data());
    const double h = 1e-5;
    std::vector<double> plus(u), minus(u), force_plus(n), force_minus(n);
    for (int i = 0; i < n; i++) plus[i] += h * v[i], minus[i] -= h * v[i];
    const double ahead = elements.energy(plus.data(), force_plus.data(), ratio.data()).value;
    const double behind = elements.energy(minus.data(), force_minus.data(), ratio.data()).value;
    double along = 0;
    for (int i = 0; i < n; i++) {
        along += force[i] * v[i];
        CHECK((force_plus[i] - force_minus[i]) / (2 * h) == doctest::Approx(tangent[i]).epsilon(1e-6).scale(0.01));
    }
    CHECK((ahead - behind) / (2 * h) == doctest::Approx(along).epsilon(1e-7));
}

TEST_CASE("an element that is stiffer than numbers can say has infinite energy") {
    const Cube cube;
    const NeoHookean elements = cube.elements(1000);
    std::vector<double> u(3 * patch_test::nodes, 0.0), force(u), ratio(elements.padded());
    for (int i = 0; i < patch_test::nodes; i++) u[3 * i] = 0.2 * cube.x[3 * i + 2];
    const NeoHookean::Energy at = elements.energy(u.data(), force.data(), ratio.data()); // shear: 2 b s = 1000 / 25
    CHECK(std::isfinite(at.value));
    CHECK(at.stiffened == doctest::Approx(40));
    for (double& x : u) x *= 4;
    CHECK(std::isinf(elements.energy(u.data(), force.data(), ratio.data()).value));
}

TEST_CASE("an inverted element has infinite energy") {
    const Cube cube;
    const NeoHookean elements = cube.elements();
    std::vector<double> u(3 * patch_test::nodes, 0.0), force(u), ratio(elements.padded());
    u[3 * patch_test::interior + 2] = -10; // below the bottom
    CHECK(std::isinf(elements.energy(u.data(), force.data(), ratio.data()).value));
}

// With the response u moves as the equilibrium does, to first order: the gradient it leaves is of second order in the
// way, and its square in the energy norm of fourth. The stiffness at rest would leave one of first order.
TEST_CASE("a tool that moves on takes the tissue along its response") {
    const Cube cube;
    const SparseCholesky rest(patch_test::free_stiffness(), &cube.x[12]);
    const NeoHookean elements = cube.elements();
    const HyperelasticModel model(elements, rest, {4, 5, 6, 7, 8});
    ContactPatch corner;
    corner.count = 1, corner.node[0] = patch_test::top[0], corner.weight[0] = 1;
    const auto left = [&](double way) {
        const auto made = model.make_state();
        auto& state = static_cast<HyperelasticState&>(*made);
        state.response = std::make_unique<ContactResponse>(model.nodes(), 1);
        const double held[3] = {0.5, -0.3, -3}, moved[3] = {0.5 + way, -0.3, -3 - way};
        double force[3];
        REQUIRE(model.solve(state, &corner, 1, held, 200, 1e-10, force) > 0);
        model.respond(state, 30);
        REQUIRE(model.solve(state, &corner, 1, moved, 0, 0, force) == 0);
        return state.gradient_norm2;
    };
    const double far = left(0.4), near = left(0.2);
    CHECK(far / near > 12);
    CHECK(far / near < 20);
}
