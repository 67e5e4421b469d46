// Limited-memory BFGS on quadratics, where theory says what it does.
#include "../random_blocks.h"
#include "linalg/lbfgs.h"
#include <doctest.h>

using namespace palpate;
using Values = std::vector<double>;

namespace {

double dot(const Values& a, const Values& b) {
    double sum = 0;
    for (size_t i = 0; i < a.size(); i++) sum += a[i] * b[i];
    return sum;
}

struct Descent {
    RandomBlocks K{8};
    Values b = K.vector(1), x = Values(K.n, 0.0), g = b;
    Lbfgs pairs;

    explicit Descent(int most) : pairs(K.n, most) {
        for (double& v : g) v = -v;
    }
    double first_inverse(int i) const { return (1 + i % 3) / K(i, i); } // H, a diagonal

    // One step with exact line search on x'Kx/2 - b'x; true: the direction is downhill.
    bool step() {
        Values d(K.n), H_y(K.n);
        for (int i = 0; i < K.n; i++) d[i] = first_inverse(i) * g[i];
        pairs.improve(g.data(), d.data());
        const Values Kd = K.times(d);
        const double down = dot(d, g), length = down / dot(d, Kd);
        Values s(K.n), y(K.n);
        for (int i = 0; i < K.n; i++) {
            s[i] = -length * d[i];
            y[i] = -length * Kd[i];
            x[i] += s[i];
            g[i] += y[i];
            H_y[i] = first_inverse(i) * y[i];
        }
        pairs.put(s.data(), y.data(), H_y.data());
        return down > 0;
    }
};

} // namespace

TEST_CASE("with a pair for every unknown it ends in as many steps, like conjugate gradients") {
    Descent run(24);
    for (int k = 0; k < run.K.n; k++) CHECK(run.step());
    const Values exact = solve_dense(run.K.dense, run.b);
    for (int i = 0; i < run.K.n; i++) CHECK(run.x[i] == doctest::Approx(exact[i]).epsilon(1e-6));
}

TEST_CASE("the improved inverse Hessian maps the newest change of the gradient to its step") {
    Descent run(4); // fewer than the steps: the oldest pairs are forgotten
    for (int k = 0; k < 7; k++) run.step();
    CHECK(run.pairs.count() == 4);
    const Values y(run.pairs.change(3), run.pairs.change(3) + run.K.n);
    Values z(run.pairs.image(3), run.pairs.image(3) + run.K.n);
    run.pairs.improve(y.data(), z.data());
    for (int i = 0; i < run.K.n; i++) CHECK(z[i] == doctest::Approx(run.pairs.step(3)[i]).epsilon(1e-9));
}

TEST_CASE("a step along which the gradient does not grow is left out") {
    Lbfgs pairs(2, 3);
    const double s[] = {1, 0}, y[] = {-1, 0.5};
    pairs.put(s, y, y);
    CHECK(pairs.count() == 0);
    double z[] = {3, 4};
    pairs.improve(z, z);
    CHECK(z[0] == 3);
    CHECK(z[1] == 4);
}
