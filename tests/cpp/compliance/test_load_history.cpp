// The history of loads against Maxwell solids by a dense matrix: every node's displacement, and the energy of all
// springs.
#include "../random_blocks.h"
#include "all_vertices.h"
#include "compliance/compliance_model.h"
#include "compliance/load_history.h"
#include <doctest.h>
#include <numeric>

using namespace palpate;

namespace {

RelaxationSpectrum two_terms() { return RelaxationSpectrum({{0.3, 0.004}, {0.3, 0.02}}); }

struct Body {
    RandomBlocks K;
    SparseCholesky factor;
    FactoredStiffness stiffness;
    GreensFunctions greens;
    explicit Body(int nodes)
        : K(nodes), factor(K.rows(), std::vector<double>(3 * nodes, 0.0).data()),
          stiffness(all_vertices(factor, nodes)), greens(stiffness, size_t(1) << 26) {
        std::vector<int> all(nodes);
        std::iota(all.begin(), all.end(), 0);
        for (int k = 0; k < nodes; k += GreensFunctions::batch)
            greens.compute_blocks(&all[k], std::min(GreensFunctions::batch, nodes - k), 100);
    }
};

// u and the branches' forces h_k everywhere, N; a tick by definition: K u' + sum h_k' = f, u even over the tick.
struct Dense {
    const RandomBlocks& K;
    RelaxationSpectrum spectrum = two_terms();
    std::vector<double> elastic;             // K u
    std::vector<std::vector<double>> branch; // h_k
    explicit Dense(const RandomBlocks& K) : K(K), elastic(K.n, 0.0), branch(2, elastic) {}
    void tick(const std::vector<double>& load) {
        for (int i = 0; i < K.n; i++) {
            double now = load[i];
            for (int k = 0; k < 2; k++) now += spectrum.gain[k] * elastic[i] - spectrum.decay[k] * branch[k][i];
            now /= 1 + spectrum.gain[0] + spectrum.gain[1];
            for (int k = 0; k < 2; k++)
                branch[k][i] = spectrum.decay[k] * branch[k][i] + spectrum.gain[k] * (now - elastic[i]);
            elastic[i] = now;
        }
    }
    double square(const std::vector<double>& p) const { // p' K^-1 p
        const std::vector<double> u = solve_dense(K.dense, p);
        return std::inner_product(p.begin(), p.end(), u.begin(), 0.0);
    }
    double energy() const {
        return 0.5 * (square(elastic) + square(branch[0]) / spectrum.ratio[0] + square(branch[1]) / spectrum.ratio[1]);
    }
};

// Ticks with random loads on the contact's vertices, by both; G f from the dense matrix.
void advance(Body& body, LoadHistory& history, Dense& truth, const std::vector<int>& contact, int ticks, int seed) {
    GreensFunctions* const greens = &body.greens;
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    for (int t = 0; t < ticks; t++) {
        REQUIRE(history.enter(&greens, contact.data(), int(contact.size()), true));
        std::vector<double> load(3 * contact.size()), whole(body.K.n, 0.0), elastic;
        for (double& f : load) f = normal(random);
        for (size_t i = 0; i < load.size(); i++) whole[3 * contact[i / 3] + i % 3] = load[i];
        const std::vector<double> u = solve_dense(body.K.dense, whole);
        for (int v : contact) elastic.insert(elastic.end(), &u[3 * v], &u[3 * v] + 3);
        history.advance(load.data(), elastic.data(), true);
        truth.tick(whole);
    }
}

} // namespace

TEST_CASE("a contact that moves, leaves and comes back finds the displacement that its history left") {
    Body body(40);
    LoadHistory history(body.stiffness, LoadRecursion::of(two_terms()));
    Dense truth(body.K);
    int seed = 1;
    for (const std::vector<int>& contact :
         {std::vector<int>{1, 5, 9}, {5, 9, 12, 20}, {}, {30, 31}, {}, {1, 2, 3, 5}, {9}}) {
        advance(body, history, truth, contact, 7, seed++);
        const std::vector<double> u = solve_dense(body.K.dense, truth.elastic);
        double size = 0;
        for (double x : u) size = std::max(size, std::abs(x));
        double found[3];
        for (size_t i = 0; i < contact.size(); i++) {
            history.displacement(int(i), found);
            for (int c = 0; c < 3; c++) CHECK(std::abs(found[c] - u[3 * contact[i] + c]) < 1e-5 * size);
        }
        for (int k = 0; k < history.size(); k++) {
            history.acting_load(k, 0, found);
            for (int c = 0; c < 3; c++) CHECK(std::abs(found[c] - truth.elastic[3 * history.vertex(k) + c]) < 1e-9);
        }
        CHECK(history.energy() == doctest::Approx(truth.energy()).epsilon(1e-4));
    }
}

TEST_CASE("a force that is not there is what the free displacement says") {
    Body body(20);
    LoadHistory history(body.stiffness, LoadRecursion::of(two_terms()));
    Dense truth(body.K);
    advance(body, history, truth, {2, 3, 7}, 5, 1);
    const std::vector<int> contact{2, 3, 7};
    GreensFunctions* const greens = &body.greens;
    REQUIRE(history.enter(&greens, contact.data(), 3, true));
    double expected[3], found[3];
    history.free_displacement(1, expected);
    const double none[9] = {};
    history.advance(none, none, true);
    history.displacement(1, found);
    for (int c = 0; c < 3; c++) CHECK(found[c] == doctest::Approx(expected[c]));
}

TEST_CASE("a history that has decayed is forgotten") {
    Body body(20);
    LoadHistory history(body.stiffness, LoadRecursion::of(two_terms()));
    Dense truth(body.K);
    advance(body, history, truth, {2, 3, 7}, 5, 1);
    CHECK(history.size() == 3);
    advance(body, history, truth, {}, 2000, 1);
    CHECK(history.size() == 0);
    CHECK(history.energy() < 1e-12);
}

TEST_CASE("the history of a long way keeps its total when it is full") {
    const int nodes = LoadHistory::capacity + 60;
    SparseCholesky factor(RandomBlocks(2).rows(), std::vector<double>(6, 0.0).data()); // not used
    FactoredStiffness stiffness{&factor.tree, &factor, {}, std::vector<int>(nodes), {}, {}, {}, {}};
    stiffness.vertex_node.resize(nodes), stiffness.vertex_free.assign(nodes, 0);
    for (int i = 0; i < nodes; i++) stiffness.position.insert(stiffness.position.end(), {0.1 * i, 0.0, 0.0});
    const RelaxationSpectrum spectrum({{0.5, 0.05}});
    LoadHistory history(stiffness, LoadRecursion::of(spectrum));
    double elastic = 0, branch = 0; // all nodes obey one recursion, and so do their sums
    FactoredStiffness small = all_vertices(factor, 2);
    GreensFunctions unread(small, 1 << 20);
    GreensFunctions* const greens = &unread;
    for (int first = 0; first + 4 <= nodes; first += 4) {
        const int contact[4] = {first, first + 1, first + 2, first + 3};
        history.enter(&greens, contact, 4, false);
        const double load[12] = {1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0}, none[12] = {};
        history.advance(load, none, false);
        const double now = (4 + spectrum.gain[0] * elastic - spectrum.decay[0] * branch) / spectrum.instant;
        branch = spectrum.decay[0] * branch + spectrum.gain[0] * (now - elastic);
        elastic = now;
    }
    CHECK(history.size() == LoadHistory::capacity);
    double total = 0, load[3];
    for (int k = 0; k < history.size(); k++) history.acting_load(k, 0, load), total += load[0];
    CHECK(elastic > 3);
    CHECK(total == doctest::Approx(elastic).epsilon(1e-9));
}

TEST_CASE("a model that relaxes begins with its instantaneous stiffness and ends with that of an elastic one") {
    Body body(30);
    const RelaxationSpectrum spectrum = two_terms();
    const ComplianceModel elastic(body.stiffness, 1 << 26), relaxing(body.stiffness, 1 << 26, spectrum);
    ContactPatch patch;
    patch.count = 3;
    for (int k = 0; k < 3; k++) patch.node[k] = 4 + 3 * k, patch.weight[k] = 1.0 / 3;
    auto a = elastic.make_state(), b = relaxing.make_state();
    double d[3] = {1, -2, 0.5}, expected[3], force[3];
    elastic.relax(*a, &patch, 1, 0, d, 1, expected);
    relaxing.relax(*b, &patch, 1, 0, d, 1, force);
    for (int c = 0; c < 3; c++) CHECK(force[c] == doctest::Approx(spectrum.instant * expected[c]).epsilon(1e-5));
    for (int t = 0; t < 2000; t++) relaxing.relax(*b, &patch, 1, 0, d, 1, force);
    for (int c = 0; c < 3; c++) CHECK(force[c] == doctest::Approx(expected[c]).epsilon(1e-5));
    b->reset();
    relaxing.relax(*b, &patch, 1, 0, d, 1, force);
    for (int c = 0; c < 3; c++) CHECK(force[c] == doctest::Approx(spectrum.instant * expected[c]).epsilon(1e-5));
}

TEST_CASE("a body whose parts all relax alike creeps as one that relaxes") {
    // E(t) = 1 + r exp(-t / tau) has the compliance 1 / (1 + r) at once, and the rest with the time tau (1 + r).
    Body body(30);
    const double share = 0.6, time = 0.3, r = share / (1 - share);
    RandomBlocks stiffer = body.K;
    for (double& value : stiffer.dense) value *= 1 + r;
    const SparseCholesky instant(stiffer.rows(), std::vector<double>(90, 0.0).data());
    const ComplianceModel relaxing(body.stiffness, 1 << 26, RelaxationSpectrum({{share, time}}));
    const ComplianceModel creeping({body.stiffness, all_vertices(instant, 30)}, 1 << 26,
                                   LoadRecursion::of({time * (1 + r)}, {1, -1}));
    auto a = relaxing.make_state(), b = creeping.make_state();
    ContactPatch patches[2];
    for (int p = 0; p < 2; p++) {
        patches[p].count = 3;
        for (int k = 0; k < 3; k++) patches[p].node[k] = 4 + 3 * k + 2 * p, patches[p].weight[k] = 1.0 / 3;
    }
    double largest = 0, off = 0;
    for (int t = 1; t <= 1500; t++) {
        const int prescribed = t <= 600 || t > 700 ? 1 : 0;
        const double depth = std::min(t, 100) / 100.0;
        double d[6] = {depth, -2 * depth, 0.5 * depth}, same[6], expected[6], found[6];
        std::copy_n(d, 6, same);
        relaxing.relax(*a, patches, prescribed, 2 - prescribed, d, 1, expected);
        creeping.relax(*b, patches, prescribed, 2 - prescribed, same, 1, found);
        for (int c = 0; c < 6; c++) {
            largest = std::max({largest, std::abs(expected[c])});
            off = std::max(off, std::abs(found[c] - expected[c]));
            CHECK(std::abs(same[c] - d[c]) < 0.01);
        }
        CHECK(creeping.energy(*b, prescribed, same, found) >= 0);
    }
    CHECK(off < 5e-3 * largest); // half a tick of the time
    CHECK(largest > 1);
}
