// Linear fields, rigid motions and energy: what any stiffness must hold exactly.
#include "../patch_test.h"
#include "elements/smoothed_stiffness.h"
#include <cmath>
#include <doctest.h>
#include <numeric>

using namespace palpate;

namespace {

struct Body {
    std::vector<double> x = patch_test::positions();
    std::vector<int> tet = patch_test::tetrahedra();
    std::vector<int32_t> region;
    std::vector<double> lam, mu;
    Body(bool two_regions)
        : region(patch_test::tets), lam(patch_test::tets, patch_test::lambda), mu(patch_test::tets, patch_test::mu) {
        for (int t = 0; t < patch_test::tets; t++) region[t] = two_regions && t % 3 == 0;
    }
    ElasticSolid solid() const {
        return {x.data(), tet.data(), region.data(), lam.data(), mu.data(), patch_test::nodes, patch_test::tets};
    }
};

std::vector<int> all_free() {
    std::vector<int> out(patch_test::nodes);
    std::iota(out.begin(), out.end(), 0);
    return out;
}

std::vector<double> times(const BlockCsr& K, const std::vector<double>& u) {
    std::vector<double> f(u.size(), 0);
    for (int i = 0; i < K.nodes(); i++)
        for (int k = K.start[i]; k < K.start[i + 1]; k++)
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) f[3 * i + a] += K.block[9 * size_t(k) + 3 * a + b] * u[3 * K.column[k] + b];
    return f;
}

// u = G x of every node.
std::vector<double> field(const std::vector<double>& x, const double G[3][3]) {
    std::vector<double> u(x.size(), 0);
    for (size_t i = 0; i < x.size(); i++)
        for (int b = 0; b < 3; b++) u[i] += G[i % 3][b] * x[i - i % 3 + b];
    return u;
}

double dot(const std::vector<double>& a, const std::vector<double>& b) {
    return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

} // namespace

TEST_CASE("the energy of a uniform strain is that of the continuum, whatever the cells") {
    const double G[3][3] = {{0.02, 0.01, -0.03}, {0.015, -0.01, 0.02}, {0.005, 0.01, 0.03}};
    double norm = 0, trace = 0;
    for (int a = 0; a < 3; a++) {
        trace += G[a][a];
        for (int b = 0; b < 3; b++) norm += (G[a][b] + G[b][a]) * (G[a][b] + G[b][a]) / 4;
    }
    for (bool two_regions : {false, true}) {
        const Body body(two_regions);
        const double volume = patch_test::edge * patch_test::edge * patch_test::edge;
        const std::vector<double> u = field(body.x, G);
        const double expected = volume * (2 * patch_test::mu * norm + patch_test::lambda * trace * trace);
        CHECK(dot(u, times(smoothed_stiffness(body.solid(), all_free()), u)) ==
              doctest::Approx(expected).epsilon(1e-10));
    }
}

TEST_CASE("rigid motions cost nothing, and the matrix is symmetric") {
    const Body body(true);
    const BlockCsr K = smoothed_stiffness(body.solid(), all_free());
    const double turn[3][3] = {{0, -0.3, 0.2}, {0.3, 0, -0.1}, {-0.2, 0.1, 0}};
    double largest = 0;
    for (double b : K.block) largest = std::max(largest, std::abs(b));
    for (double f : times(K, field(body.x, turn))) CHECK(std::abs(f) < 1e-10 * largest * patch_test::edge);
    for (double f : times(K, std::vector<double>(body.x.size(), 1.0))) CHECK(std::abs(f) < 1e-10 * largest);
    std::vector<double> u(body.x.size()), v(body.x.size());
    for (size_t i = 0; i < u.size(); i++) u[i] = std::sin(7.0 * double(i)), v[i] = std::cos(3.0 * double(i * i % 101));
    CHECK(dot(u, times(K, v)) == doctest::Approx(dot(v, times(K, u))).epsilon(1e-10));
    CHECK(dot(u, times(K, u)) > 0);
}

TEST_CASE("held nodes are left out, and the rest stays as it was") {
    const Body body(false);
    std::vector<int> free_index(patch_test::nodes, -1);
    std::vector<double> u(body.x.size(), 0), part;
    int free = 0;
    for (int i = 0; i < patch_test::nodes; i++) {
        if (i % 4 == 0) continue;
        free_index[i] = free++;
        for (int k = 0; k < 3; k++) u[3 * i + k] = std::sin(double(3 * i + k)), part.push_back(u[3 * i + k]);
    }
    const std::vector<double> whole = times(smoothed_stiffness(body.solid(), all_free()), u);
    const std::vector<double> rest = times(smoothed_stiffness(body.solid(), free_index), part);
    for (int i = 0; i < patch_test::nodes; i++)
        for (int k = 0; k < 3 && free_index[i] >= 0; k++)
            CHECK(rest[3 * free_index[i] + k] == doctest::Approx(whole[3 * i + k]).epsilon(1e-9));
}

TEST_CASE("with a cell for each tetrahedron it is the stiffness of P1 elements") {
    const Body body(false);
    const std::vector<double> expected = patch_test::dense_stiffness();
    std::vector<double> u(body.x.size(), 0);
    for (size_t n = 0; n < u.size(); n++) {
        u[n] = 1;
        const std::vector<double> column = times(p1_stiffness(body.solid(), all_free()), u);
        for (size_t i = 0; i < u.size(); i++)
            CHECK(column[i] == doctest::Approx(expected[i * u.size() + n]).epsilon(1e-10).scale(1e-2));
        u[n] = 0;
    }
}

TEST_CASE("a tetrahedron that is half there has half the stiffness") {
    const Body body(true);
    const std::vector<double> half(patch_test::tets, 0.5);
    ElasticSolid solid = body.solid();
    solid.filled = half.data();
    for (auto* made : {&smoothed_stiffness, &p1_stiffness}) {
        const BlockCsr whole = made(body.solid(), all_free()), part = made(solid, all_free());
        REQUIRE(part.block.size() == whole.block.size());
        for (size_t k = 0; k < whole.block.size(); k++)
            CHECK(part.block[k] == doctest::Approx(whole.block[k] / 2).epsilon(1e-12).scale(1e-6));
    }
}
