#include "../random_blocks.h"
#include "multigrid/smoother.h"
#include <algorithm>
#include <doctest.h>

using namespace palpate;
using Vector = std::vector<double>;

namespace {

AlignedBuffer packed(const Vector& x) { // four floats per node
    AlignedBuffer out(x.size() / 3 * 4, 0.0f);
    for (size_t i = 0; i < x.size(); i++) out[i / 3 * 4 + i % 3] = float(x[i]);
    return out;
}

void check_equal(const AlignedBuffer& got, const Vector& expected) {
    double largest = 0, error = 0;
    for (double v : expected) largest = std::max(largest, std::abs(v));
    for (size_t i = 0; i < expected.size(); i++)
        error = std::max(error, std::abs(got[i / 3 * 4 + i % 3] - expected[i]));
    CHECK(error <= 2e-5 * largest);
    for (size_t i = 3; i < got.size(); i += 4) CHECK(got[i] == 0);
}

Vector minus(Vector a, const Vector& b) {
    for (size_t i = 0; i < a.size(); i++) a[i] -= b[i];
    return a;
}
Vector plus(Vector a, const Vector& b) {
    for (size_t i = 0; i < a.size(); i++) a[i] += b[i];
    return a;
}

// (D/omega + L) d = r, or L' in place of L: D the 3x3 diagonal blocks, L the blocks below them. In float64.
Vector sor_step(const RandomBlocks& K, double omega, const Vector& r, bool transposed) {
    Vector A(K.dense.size(), 0.0);
    for (int i = 0; i < K.n; i++)
        for (int j = 0; j < K.n; j++) {
            if (i / 3 == j / 3) A[size_t(i) * K.n + j] = K(i, j) / omega;
            if (transposed ? i / 3 < j / 3 : i / 3 > j / 3) A[size_t(i) * K.n + j] = K(i, j);
        }
    return solve_dense(A, r);
}

Vector lower_times(const RandomBlocks& K, const Vector& d) {
    Vector y(K.n, 0.0);
    for (int i = 0; i < K.n; i++)
        for (int j = 0; j < i / 3 * 3; j++) y[i] += K(i, j) * d[j];
    return y;
}

double energy(const RandomBlocks& K, const AlignedBuffer& x, const Vector& b) { // x'Kx/2 - b'x
    Vector u(K.n);
    for (int i = 0; i < K.n; i++) u[i] = x[i / 3 * 4 + i % 3];
    const Vector f = K.times(u);
    double sum = 0;
    for (int i = 0; i < K.n; i++) sum += u[i] * (0.5 * f[i] - b[i]);
    return sum;
}

constexpr int nodes = 37;

} // namespace

TEST_CASE("two sweeps forward equal (D/omega + L) d = r, and leave the residual") {
    const RandomBlocks K(nodes);
    const HalfBlockCsr half(K.rows(), nullptr);
    for (double omega : {0.7, 1.0, 1.4}) {
        Vector r = K.vector(2);
        AlignedBuffer from = packed(r), next(4 * nodes, 0.0f), d(4 * nodes, 0.0f), x(4 * nodes, 99.0f);
        const Vector first = sor_step(K, omega, r, false);
        r = minus(r, K.times(first));
        sor_forward(half, float(omega), from.data(), d.data(), next.data(), x.data(), true);
        check_equal(d, first);
        check_equal(x, first);
        check_equal(next, r);
        const Vector second = sor_step(K, omega, r, false);
        std::fill(from.begin(), from.end(), 0.0f);
        sor_forward(half, float(omega), next.data(), d.data(), from.data(), x.data(), false);
        check_equal(d, second);
        check_equal(x, plus(first, second));
        check_equal(from, minus(r, K.times(second)));
    }
}

TEST_CASE("two sweeps backward equal (D/omega + L') d = r - K e; the product that follows is K x") {
    const RandomBlocks K(nodes, 3);
    const HalfBlockCsr half(K.rows(), nullptr);
    for (double omega : {0.8, 1.3}) {
        const Vector x0 = K.vector(4), b = K.vector(5), e = K.vector(6);
        Vector r = minus(b, K.times(x0));
        AlignedBuffer residual = packed(r), d(4 * nodes, 0.0f), scatter(4 * nodes, 0.0f), x = packed(x0);
        r = minus(r, K.times(e));
        const Vector first = sor_step(K, omega, r, true);
        r = minus(r, K.times(first));
        sor_backward_first(half, float(omega), packed(e).data(), residual.data(), d.data(), scatter.data(), x.data());
        check_equal(d, first);
        check_equal(x, plus(plus(x0, e), first));
        check_equal(residual, plus(r, lower_times(K, first))); // stored without -L d
        const Vector second = sor_step(K, omega, r, true);
        r = minus(r, K.times(second));
        std::fill(scatter.begin(), scatter.end(), 0.0f);
        sor_backward(half, float(omega), residual.data(), d.data(), scatter.data(), x.data());
        const Vector end = plus(plus(plus(x0, e), first), second);
        check_equal(d, second);
        check_equal(x, end);
        check_equal(residual, plus(r, lower_times(K, second)));
        AlignedBuffer product(4 * nodes);
        product_from_residual(half, packed(b).data(), residual.data(), d.data(), product.data());
        check_equal(product, K.times(end));
    }
}

TEST_CASE("the product with the half matrix equals the dense one") {
    const RandomBlocks K(nodes, 7);
    const Vector x = K.vector(8);
    AlignedBuffer product(4 * nodes);
    multiply(HalfBlockCsr(K.rows(), nullptr), packed(x).data(), product.data());
    check_equal(product, K.times(x));
}

TEST_CASE("excluded nodes stay at zero, and the others see no force of theirs") {
    RandomBlocks K(nodes, 9);
    const BlockCsr rows = K.rows();
    std::vector<uint8_t> excluded(nodes, 0);
    excluded[4] = excluded[20] = excluded[36] = 1;
    Vector r = K.vector(10), fixed_r = r;
    for (int i = 0; i < K.n; i++) {
        if (!excluded[i / 3]) continue;
        fixed_r[i] = 0;
        for (int j = 0; j < K.n; j++) K.dense[size_t(i) * K.n + j] = K.dense[size_t(j) * K.n + i] = i == j;
    }
    AlignedBuffer next(4 * nodes, 0.0f), d(4 * nodes, 0.0f), x(4 * nodes, 0.0f), product(4 * nodes);
    sor_forward(HalfBlockCsr(rows, excluded.data()), 1, packed(r).data(), d.data(), next.data(), x.data(), true);
    const Vector step = sor_step(K, 1, fixed_r, false);
    check_equal(x, step);
    multiply(HalfBlockCsr(rows, excluded.data()), packed(step).data(), product.data());
    check_equal(product, K.times(step)); // step is zero at excluded nodes
}

TEST_CASE("every sweep lowers the energy x'Kx/2 - b'x for 0 < omega < 2") {
    const RandomBlocks K(nodes, 11);
    const HalfBlockCsr half(K.rows(), nullptr);
    const Vector b = K.vector(12), none(K.n, 0.0);
    for (double omega : {0.5, 1.0, 1.9}) {
        AlignedBuffer r = packed(b), next(4 * nodes), d(4 * nodes, 0.0f), x(4 * nodes, 0.0f);
        double before = 0;
        for (int sweep = 0; sweep < 6; sweep++) {
            sor_forward(half, float(omega), r.data(), d.data(), next.data(), x.data(), sweep == 0);
            std::swap(r, next);
            const double now = energy(K, x, b);
            CHECK(now < before);
            before = now;
        }
        for (int sweep = 0; sweep < 6; sweep++) {
            std::fill(next.begin(), next.end(), 0.0f);
            if (sweep == 0)
                sor_backward_first(half, float(omega), packed(none).data(), r.data(), d.data(), next.data(), x.data());
            else
                sor_backward(half, float(omega), r.data(), d.data(), next.data(), x.data());
            const double now = energy(K, x, b);
            CHECK(now < before);
            before = now;
        }
    }
}
