// Forward and backward substitution against dense float64 solves.
#include "../random_blocks.h"
#include "linalg/sparse_cholesky.h"
#include "linalg/triangular_solve.h"
#include <algorithm>
#include <doctest.h>
#include <numeric>

using namespace palpate;
using Values = std::vector<double>;

namespace {

constexpr int nodes = 70;

struct Factored {
    RandomBlocks K{nodes};
    SparseCholesky factor;
    std::vector<int> all;

    static Values places() {
        Values out(3 * nodes, 0.0);
        for (int i = 0; i < nodes; i++) out[3 * i] = i; // the nodes are coupled along a line
        return out;
    }
    Factored() : factor(K.rows(), places().data()), all(factor.tree.count()) { std::iota(all.begin(), all.end(), 0); }
    int unknown(int i) const { return 3 * factor.tree.place[i / 3] + i % 3; } // in the order of elimination
};

double inner(const Values& a, const Values& b) { return std::inner_product(a.begin(), a.end(), b.begin(), 0.0); }

double relative_error(const Values& x, const Values& expected) {
    double error = 0, largest = 0;
    for (size_t i = 0; i < x.size(); i++) {
        error = std::max(error, std::abs(x[i] - expected[i]));
        largest = std::max(largest, std::abs(expected[i]));
    }
    return error / largest;
}

// Eleven right-hand sides in two groups of eight, then one alone.
template <class T> void check(const FactorValues<T>& value, double tolerance) {
    const Factored f;
    const Supernodes& tree = f.factor.tree;
    TriangularSolve<T> many(tree, 16), one(tree, 1);
    for (int column = 0; column < 11; column++)
        for (int i = 0; i < f.K.n; i++) many.of(column / 8, f.unknown(i))[column % 8] = T(f.K.vector(column + 5)[i]);
    many.forward(value.data(), f.all.data(), tree.count());
    // y = L^-1 b has y.y = b.K^-1 b
    std::vector<Values> expected;
    for (int column = 0; column < 11; column++) {
        const Values b = f.K.vector(column + 5);
        expected.push_back(solve_dense(f.K.dense, b));
        double square = 0;
        for (int u = 0; u < f.K.n; u++) square += std::pow(double(many.of(column / 8, u)[column % 8]), 2);
        CHECK(std::abs(square / inner(b, expected.back()) - 1) < tolerance);
    }
    many.backward(value.data(), f.all.data(), tree.count());
    for (int column = 0; column < 11; column++) {
        Values x;
        for (int i = 0; i < f.K.n; i++) x.push_back(many.of(column / 8, f.unknown(i))[column % 8]);
        CHECK(relative_error(x, expected[column]) < tolerance);
    }
    const Values b = f.K.vector(5);
    for (int i = 0; i < f.K.n; i++) one.x[f.unknown(i)] = T(b[i]);
    one.forward(value.data(), f.all.data(), tree.count());
    double square = 0;
    for (int u = 0; u < f.K.n; u++) square += std::pow(double(one.x[u]), 2);
    CHECK(std::abs(square / inner(b, expected[0]) - 1) < tolerance);
    one.backward(value.data(), f.all.data(), tree.count());
    Values x;
    for (int i = 0; i < f.K.n; i++) x.push_back(one.x[f.unknown(i)]);
    CHECK(relative_error(x, expected[0]) < tolerance);
}

} // namespace

TEST_CASE("substitution in float64 is the dense solution") {
    const Factored f;
    REQUIRE(f.factor.positive);
    REQUIRE(f.factor.tree.count() > 3);
    check(f.factor.value, 1e-9);
}

TEST_CASE("substitution in float32 is the dense solution but for rounding") {
    check(Factored().factor.rounded(), 2e-3);
}

TEST_CASE("clear zeroes the visited supernodes and no others") {
    const Factored f;
    TriangularSolve<double> work(f.factor.tree, 8);
    std::fill(work.x.begin(), work.x.end(), 1.0);
    const int visited[] = {1};
    work.clear(visited, 1);
    for (int u = 0; u < f.K.n; u++)
        for (int column = 0; column < 8; column++)
            CHECK(work.of(0, u)[column] == (f.factor.tree.part[u / 3] == 1 ? 0 : 1));
}
