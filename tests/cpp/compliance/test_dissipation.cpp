// Tissue that relaxes or has mass takes at least as much work in a tick as its energy grows by, whatever the hand does.
#include "../random_blocks.h"
#include "all_vertices.h"
#include "compliance/compliance_model.h"
#include <doctest.h>
#include <numeric>

using namespace palpate;

namespace {

constexpr int nodes = 15, n = 3 * nodes;

double dot(const std::vector<double>& a, const std::vector<double>& b) {
    return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

// The lowest modes of K with a unit mass at each node times `mass`, by inverse iteration.
VibrationModes lowest_modes(const RandomBlocks& K, int count, double mass, double damping,
                            const RelaxationSpectrum& spectrum) {
    std::vector<std::vector<double>> shapes;
    std::vector<double> frequency;
    std::mt19937 random(5);
    std::normal_distribution<double> normal;
    for (int m = 0; m < count; m++) {
        std::vector<double> x(n);
        for (double& v : x) v = normal(random);
        double stiffness = 0;
        for (int step = 0; step < 2000; step++) {
            x = solve_dense(K.dense, x);
            for (const auto& other : shapes) {
                const double part = dot(other, x);
                for (int i = 0; i < n; i++) x[i] -= part * other[i];
            }
            const double size = std::sqrt(dot(x, x));
            for (double& v : x) v /= size;
        }
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) stiffness += x[i] * K(i, j) * x[j];
        shapes.push_back(x);
        frequency.push_back(std::sqrt(stiffness / mass));
    }
    std::vector<float> values(size_t(n) * count);
    for (int i = 0; i < nodes; i++)
        for (int m = 0; m < count; m++)
            for (int c = 0; c < 3; c++)
                values[(size_t(i) * count + m) * 3 + c] = float(shapes[m][3 * i + c] / std::sqrt(mass));
    return VibrationModes(frequency, values, damping, 2e-3, spectrum);
}

ContactPatch patch(int first, double weight) {
    ContactPatch out;
    out.count = 2;
    out.node[0] = first, out.node[1] = first + 1;
    out.weight[0] = weight, out.weight[1] = 1 - weight;
    return out;
}

// Random pushes and rests at two places.
void push_about(const ComplianceModel& model, int seed) {
    auto state = model.make_state();
    const ContactPatch patches[2] = {patch(2, 0.3), patch(3, 0.6)};
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    double stored = 0, largest = 0, lost = 0;
    for (int round = 0; round < 40; round++) {
        const ContactPatch& under = patches[random() % 2];
        const double speed = std::pow(10.0, -int(random() % 3));
        double d[3], force[3];
        for (int rest = 0; rest < int(random() % 30) + 1; rest++) { // without a tool energy does not grow
            model.relax(*state, &under, 0, 1, d, 1, force);
            const double now = model.energy(*state, 0, nullptr, nullptr);
            CHECK(now - stored <= 2e-5 * largest);
            stored = now;
        }
        for (int t = 0; t < 100; t++) {
            double work = 0, next[3];
            for (int c = 0; c < 3; c++) next[c] = d[c] + speed * normal(random) - 0.1 * d[c];
            REQUIRE(model.relax(*state, &under, 1, 0, next, 1, force));
            for (int c = 0; c < 3; c++) work -= force[c] * (next[c] - d[c]), d[c] = next[c];
            const double now = model.energy(*state, 1, d, force);
            largest = std::max({largest, now, std::abs(work)});
            CHECK(work - (now - stored) >= -2e-5 * largest);
            lost += work - (now - stored);
            stored = now;
        }
    }
    CHECK(largest > 0);
    CHECK(lost > 0);
}

} // namespace

TEST_CASE("each tick takes at least the work that its energy grows by") {
    const RandomBlocks K(nodes);
    const SparseCholesky factor(K.rows(), std::vector<double>(n, 0.0).data());
    RandomBlocks half = K; // a body a part of which is stiffer at once
    for (int i = 0; i < n; i++) half.dense[size_t(i) * n + i] += half.dense[size_t(i) * n + i] * (i % 2);
    const SparseCholesky stiffer(half.rows(), std::vector<double>(n, 0.0).data());
    const RelaxationSpectrum elastic, relaxing({{0.3, 0.003}, {0.3, 0.05}});
    for (int seed = 1; seed <= 3; seed++) {
        push_about(ComplianceModel(all_vertices(factor, nodes), 1 << 26, relaxing), seed);
        push_about(ComplianceModel({all_vertices(factor, nodes), all_vertices(stiffer, nodes)}, 1 << 26,
                                   LoadRecursion::of({0.004, 0.06}, {0.3, -0.3, 0.7, -0.7})),
                   seed);
        for (double damping : {0.0, 0.1})
            for (const RelaxationSpectrum* spectrum : {&elastic, &relaxing})
                push_about(
                    ComplianceModel(all_vertices(factor, nodes), 1 << 26, lowest_modes(K, 6, 1e-5, damping, *spectrum)),
                    seed);
    }
}
