#include "multigrid/v_cycle.h"
#include <algorithm>
#include <cmath>
#include <doctest.h>
#include <random>

using namespace palpate;

namespace {

// A box of cells, each in six tetrahedra around its diagonal; the nodes of x = 0 are fixed. Stiffness varies by a
// factor.
struct Box {
    std::vector<double> node, lam, mu;
    std::vector<int32_t> tet;
    std::vector<uint8_t> fixed;
    ElasticMesh mesh;
    Box(int a, int b, int c, double edge, double contrast) {
        std::mt19937 random(1);
        std::uniform_real_distribution<double> exponent(0, std::log(contrast));
        auto index = [&](int i, int j, int k) { return (i * (b + 1) + j) * (c + 1) + k; };
        for (int i = 0; i <= a; i++)
            for (int j = 0; j <= b; j++)
                for (int k = 0; k <= c; k++) {
                    node.insert(node.end(), {edge * i, edge * j, edge * k});
                    fixed.push_back(i == 0);
                }
        const int paths[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
        for (int i = 0; i < a; i++)
            for (int j = 0; j < b; j++)
                for (int k = 0; k < c; k++)
                    for (const int* path : paths) {
                        int at[3] = {i, j, k};
                        tet.push_back(index(at[0], at[1], at[2]));
                        for (int step = 0; step < 3; step++) {
                            at[path[step]]++;
                            tet.push_back(index(at[0], at[1], at[2]));
                        }
                        const double E = 1e-3 * std::exp(exponent(random)), nu = 0.4;
                        lam.push_back(E * nu / (1 + nu) / (1 - 2 * nu));
                        mu.push_back(E / 2 / (1 + nu));
                    }
        mesh = {node.data(), tet.data(), lam.data(), mu.data(), fixed.data(), int(fixed.size()), int(lam.size())};
    }
};

std::vector<double> times(const BlockCsr& K, const std::vector<double>& x) { // (nodes, 3)
    std::vector<double> y(x.size(), 0.0);
    for (int i = 0; i < K.nodes(); i++)
        for (int k = K.start[i]; k < K.start[i + 1]; k++)
            for (int e = 0; e < 9; e++) y[3 * i + e / 3] += K.block[9 * size_t(k) + e] * x[3 * K.column[k] + e % 3];
    return y;
}

double dot(const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0;
    for (size_t i = 0; i < a.size(); i++) sum += a[i] * b[i];
    return sum;
}

struct Preconditioner {
    const VCycle& cycle;
    VCycleWorkspace work;
    AlignedBuffer rhs, x, product;
    explicit Preconditioner(const VCycle& c)
        : cycle(c), work(c.make_workspace()), rhs(4 * c.nodes()), x(rhs), product(rhs) {}
    std::vector<double> operator()(const std::vector<double>& b, int sweeps) {
        for (size_t i = 0; i < b.size(); i++) rhs[i / 3 * 4 + i % 3] = float(b[i]);
        cycle.apply(work, sweeps, rhs.data(), x.data(), product.data());
        std::vector<double> out(b.size());
        for (size_t i = 0; i < b.size(); i++) out[i] = x[i / 3 * 4 + i % 3];
        return out;
    }
};

std::vector<double> random_vector(const Box& box, unsigned seed) { // zero at fixed nodes
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    std::vector<double> out(box.node.size());
    for (size_t i = 0; i < out.size(); i++) out[i] = box.fixed[i / 3] ? 0 : normal(random);
    return out;
}

} // namespace

TEST_CASE("the elements' stiffness: no force on rigid motions, exact energy of a linear displacement") {
    const Box box(3, 4, 2, 2.5, 1);
    const BlockCsr K = assemble_stiffness(box.mesh);
    const double gradient[3][3] = {{0.1, 0.4, -0.3}, {-0.2, 0.05, 0.7}, {0.6, -0.1, -0.25}};
    const double turn[3][3] = {{0, 0.4, -0.3}, {-0.4, 0, 0.7}, {0.3, -0.7, 0}};
    std::vector<double> linear(box.node.size()), rigid(linear.size());
    for (size_t i = 0; i < linear.size(); i++) {
        rigid[i] = 1 + i % 3;
        for (int k = 0; k < 3; k++) {
            linear[i] += gradient[i % 3][k] * box.node[i / 3 * 3 + k];
            rigid[i] += turn[i % 3][k] * box.node[i / 3 * 3 + k];
        }
    }
    for (double f : times(K, rigid)) CHECK(std::abs(f) < 1e-15);
    double trace = 0, square = 0;
    for (int a = 0; a < 3; a++) {
        trace += gradient[a][a];
        for (int b = 0; b < 3; b++) square += std::pow((gradient[a][b] + gradient[b][a]) / 2, 2);
    }
    const double volume = 3 * 4 * 2 * std::pow(2.5, 3);
    const double energy = volume * (box.lam[0] / 2 * trace * trace + box.mu[0] * square);
    CHECK(dot(linear, times(K, linear)) / 2 == doctest::Approx(energy).epsilon(1e-12));
}

TEST_CASE("the V-cycle is symmetric and positive definite, whatever the number of fine sweeps") {
    const Box box(5, 5, 5, 2, 30);
    const BlockCsr K = assemble_stiffness(box.mesh);
    const VCycle cycle(K, box.mesh, 2, 2, 1.1);
    REQUIRE(cycle.level_sizes().size() >= 2);
    Preconditioner B(cycle);
    std::vector<int> unknown;
    for (size_t i = 0; i < box.node.size(); i++)
        if (!box.fixed[i / 3]) unknown.push_back(int(i));
    const int n = int(unknown.size());
    for (int sweeps : {1, 2}) {
        std::vector<double> dense(size_t(n) * n), unit(box.node.size(), 0.0);
        double largest = 0, asymmetry = 0;
        for (int j = 0; j < n; j++) {
            unit[unknown[j]] = 1;
            const std::vector<double> column = B(unit, sweeps);
            unit[unknown[j]] = 0;
            for (int i = 0; i < n; i++) dense[size_t(i) * n + j] = column[unknown[i]];
        }
        for (int i = 0; i < n; i++)
            for (int j = 0; j < i; j++) {
                double &a = dense[size_t(i) * n + j], &b = dense[size_t(j) * n + i];
                largest = std::max(largest, std::abs(a)), asymmetry = std::max(asymmetry, std::abs(a - b));
                a = b = (a + b) / 2;
            }
        CHECK(asymmetry < 1e-5 * largest);
        bool positive = true; // Cholesky
        for (int i = 0; i < n && positive; i++)
            for (int j = 0; j <= i; j++) {
                double sum = dense[size_t(i) * n + j];
                for (int k = 0; k < j; k++) sum -= dense[size_t(i) * n + k] * dense[size_t(j) * n + k];
                if (i == j) positive = positive && sum > 0;
                dense[size_t(i) * n + j] = i == j ? std::sqrt(sum) : sum / dense[size_t(j) * n + j];
            }
        CHECK(positive);
    }
}

TEST_CASE("the V-cycle's second result is K times its first, fixed nodes stay at zero") {
    const Box box(6, 5, 4, 2, 10);
    const BlockCsr K = assemble_stiffness(box.mesh);
    const VCycle cycle(K, box.mesh, 2, 2, 1.0);
    Preconditioner B(cycle);
    const std::vector<double> x = B(random_vector(box, 1), 2), force = times(K, x);
    double largest = 0, error = 0;
    for (size_t i = 0; i < x.size(); i++) {
        if (box.fixed[i / 3]) {
            CHECK(x[i] == 0);
            continue;
        }
        largest = std::max(largest, std::abs(force[i]));
        error = std::max(error, std::abs(force[i] - B.product[i / 3 * 4 + i % 3]));
    }
    CHECK(error < 1e-5 * largest);
}

TEST_CASE("V-cycles alone converge: the error's energy norm at least halves, on every size of mesh") {
    for (int cells : {5, 8, 12}) {
        const Box box(cells, cells, cells, 24.0 / cells, 1);
        const BlockCsr K = assemble_stiffness(box.mesh);
        const VCycle cycle(K, box.mesh, 24.0 / cells, 2, 1.0);
        Preconditioner B(cycle);
        const std::vector<double> exact = random_vector(box, 2), b = times(K, exact);
        std::vector<double> error = exact;
        double before = std::sqrt(dot(error, times(K, error)));
        for (int k = 0; k < 6; k++) {
            std::vector<double> r = times(K, error);
            for (size_t i = 0; i < r.size(); i++)
                if (box.fixed[i / 3]) r[i] = 0;
            const std::vector<double> step = B(r, 2);
            for (size_t i = 0; i < step.size(); i++) error[i] -= step[i];
            const double now = std::sqrt(dot(error, times(K, error)));
            CHECK(now < 0.5 * before);
            before = now;
        }
    }
}
