// Solves for loads on a few nodes and solutions on a few, against dense float64 solves.
#include "../random_blocks.h"
#include "linalg/partial_solve.h"
#include "linalg/sparse_cholesky.h"
#include <algorithm>
#include <doctest.h>

using namespace palpate;
using Values = std::vector<double>;

namespace {

constexpr int nodes = 70, columns = 16;

struct Factored {
    RandomBlocks K{nodes};
    SparseCholesky factor;
    static Values places() {
        Values out(3 * nodes, 0.0);
        for (int i = 0; i < nodes; i++) out[3 * i] = i;
        return out;
    }
    Factored() : factor(K.rows(), places().data()) {}
};

// Largest error over the largest value of the dense solution, of `used` random right-hand sides.
template <class T>
double error(const Factored& f, PartialSolve<T>& partial, const std::vector<int>& loaded,
             const std::vector<int>& wanted, int used, unsigned seed) {
    std::vector<T> load(3 * loaded.size() * columns, T(0)), out(3 * wanted.size() * columns, T(0));
    double worst = 0, largest = 0;
    std::vector<Values> expected;
    for (int c = 0; c < used; c++) {
        const Values random = f.K.vector(seed + c);
        Values b(f.K.n, 0.0);
        for (size_t i = 0; i < 3 * loaded.size(); i++) {
            load[i * columns + c] = T(random[i]);
            b[3 * loaded[i / 3] + i % 3] = load[i * columns + c];
        }
        expected.push_back(solve_dense(f.K.dense, b));
    }
    partial.solve(loaded.data(), int(loaded.size()), load.data(), wanted.data(), int(wanted.size()), out.data(), used);
    for (int c = 0; c < used; c++)
        for (size_t i = 0; i < 3 * wanted.size(); i++) {
            const double x = expected[c][3 * wanted[i / 3] + i % 3];
            worst = std::max(worst, std::abs(out[i * columns + c] - x));
            largest = std::max(largest, std::abs(x));
        }
    return worst / largest;
}

} // namespace

TEST_CASE("the wanted part of the solution is that of the dense solution") {
    const Factored f;
    REQUIRE(f.factor.positive);
    REQUIRE(f.factor.tree.count() > 3);
    PartialSolve<double> partial(f.factor.tree, f.factor.value.data(), columns);
    CHECK(error(f, partial, {3}, {3}, 1, 1) < 1e-9);
    CHECK(error(f, partial, {0, 69, 12}, {40, 1, 2, 68}, 3, 2) < 1e-9);
    CHECK(error(f, partial, {50, 21}, {50, 0, 21, 33}, 16, 3) < 1e-9); // nothing is left of earlier solves
    CHECK(error(f, partial, {7}, {66}, 11, 4) < 1e-9);
}

TEST_CASE("the wanted part in float32 is that of the dense solution but for rounding") {
    const Factored f;
    const FactorValues<float> value = f.factor.rounded();
    PartialSolve<float> partial(f.factor.tree, value.data(), columns);
    CHECK(error(f, partial, {0, 69, 12}, {40, 1, 2, 68}, 3, 2) < 2e-3);
}

TEST_CASE("what else is wanted and other columns change no bit") {
    const Factored f;
    PartialSolve<double> partial(f.factor.tree, f.factor.value.data(), columns);
    const int loaded[] = {5, 30}, few[] = {8}, more[] = {60, 8, 22};
    Values load(6 * columns, 0.0), a(3 * columns), b(9 * columns);
    for (int i = 0; i < 6; i++) load[i * columns] = i + 1, load[i * columns + 1] = -i;
    partial.solve(loaded, 2, load.data(), few, 1, a.data(), 1);
    partial.solve(loaded, 2, load.data(), more, 3, b.data(), 12);
    for (int i = 0; i < 3; i++) CHECK(a[i * columns] == b[(3 + i) * columns]);
}
