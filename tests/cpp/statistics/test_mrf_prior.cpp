// The prior against its formula summed pair by pair, its gradient by finite differences, and its potentials.
#include "statistics/mrf_prior.h"
#include "statistics/mrf_prior_row.h"
#include <cmath>
#include <doctest.h>
#include <memory>
#include <random>
#include <vector>

using namespace palpate;

namespace {

constexpr float edge = 0.02f, exponent = 1.3f;

double psi(Potential potential, double t) {
    const double s = std::fabs(t) / edge, d2 = double(edge) * edge;
    switch (potential) {
    case Potential::huber:
        return d2 * (s < 1 ? s * s / 2 : s - 0.5);
    case Potential::lange:
        return d2 * (s - std::log1p(s));
    case Potential::hyperbola:
        return d2 * (std::sqrt(1 + s * s) - 1);
    case Potential::generalised:
        return d2 * s * s / 2 / (1 + std::pow(s, 2 - double(exponent)));
    case Potential::tabulated: // of the weight 1 / (1 + s) below
        return d2 * (s - std::log1p(s));
    case Potential::quadratic:
        break;
    }
    return t * t / 2;
}

// Lange's weight 1 / (1 + s), tabulated, and the integral of s / (1 + s).
const PotentialTable& table() {
    static const auto made = [] {
        auto out = std::make_unique<PotentialTable>();
        for (int i = 0; i < PotentialTable::size; i++) {
            const int octave = i / PotentialTable::steps - PotentialTable::octaves, part = i % PotentialTable::steps;
            const double s = std::ldexp(1 + double(part) / PotentialTable::steps, octave);
            out->weight[i] = float(1 / (1 + s));
            out->value[i] = float(s - std::log1p(s));
        }
        return out;
    }();
    return *made;
}

const Potential potentials[] = {Potential::quadratic, Potential::huber,       Potential::lange,
                                Potential::hyperbola, Potential::generalised, Potential::tabulated};

PotentialParameters parameters(Potential potential) { return {potential, edge, exponent, &table()}; }

const int64_t shape[3] = {4, 6, 21};
const double spacing[3] = {2.0, 1.0, 0.8};

std::vector<float> volume(unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> uniform(0, 0.06f);
    std::vector<float> f(shape[0] * shape[1] * shape[2]);
    for (float& value : f) value = uniform(random);
    return f;
}

// visit(j, weight) for each neighbour j of voxel i.
template <class Visit> void for_neighbours(int64_t i, int neighbours, Visit visit) {
    const int64_t at[3] = {i / (shape[1] * shape[2]), i / shape[2] % shape[1], i % shape[2]};
    const int most = neighbours == 6 ? 1 : neighbours == 18 ? 2 : 3;
    for (int d = 0; d < 27; d++) {
        const int step[3] = {d / 9 - 1, d / 3 % 3 - 1, d % 3 - 1};
        double square = 0;
        int differing = 0;
        bool inside = true;
        for (int k = 0; k < 3; k++) {
            square += std::pow(step[k] * spacing[k], 2);
            differing += step[k] != 0;
            inside = inside && at[k] + step[k] >= 0 && at[k] + step[k] < shape[k];
        }
        if (differing == 0 || differing > most || !inside) continue;
        visit(((at[0] + step[0]) * shape[1] + at[1] + step[1]) * shape[2] + at[2] + step[2],
              spacing[0] * spacing[1] * spacing[2] / (std::sqrt(square) * 0.8));
    }
}

} // namespace

TEST_CASE("the weight of a potential is its derivative over its argument") {
    for (Potential potential : potentials)
        for (double t = -0.3; t < 0.3; t += 0.00137) {
            const double h = 1e-6, slope = (psi(potential, t + h) - psi(potential, t - h)) / (2 * h);
            const bool corner = potential == Potential::huber && std::fabs(std::fabs(t) - edge) < 2 * h;
            const double tolerance = corner ? 1e-4 : potential == Potential::tabulated ? 5e-6 : 1e-6;
            CHECK(std::fabs(t * potential_curvature(parameters(potential), float(t)) - slope) < tolerance);
        }
}

TEST_CASE("the parabola of a potential touches it and lies above it") {
    for (Potential potential : potentials)
        for (double t0 : {0.001, 0.015, 0.05, 0.4}) {
            const double k = potential_curvature(parameters(potential), float(t0));
            for (double t = -0.6; t <= 0.6; t += 0.0021)
                CHECK(psi(potential, t0) + 0.5 * k * (t * t - t0 * t0) >= psi(potential, t) - 1e-7);
        }
}

TEST_CASE("value, gradient and curvature are sums over pairs of neighbours, each pair once") {
    const std::vector<float> f = volume(1);
    for (Potential potential : potentials)
        for (int neighbours : {6, 18, 26}) {
            const Neighbourhood n = neighbourhood(shape, spacing, parameters(potential), neighbours);
            std::vector<float> gradient(f.size()), curvature(f.size());
            prior_surrogate(n, f.data(), gradient.data(), curvature.data());
            double value = 0;
            for (size_t i = 0; i < f.size(); i++) {
                double slope = 0, k = 0;
                for_neighbours(int64_t(i), neighbours, [&](int64_t j, double weight) {
                    const double t = double(f[i]) - f[j], h = 1e-6;
                    value += 0.5 * weight * psi(potential, t);
                    slope += weight * (psi(potential, t + h) - psi(potential, t - h)) / (2 * h);
                    k += weight * potential_curvature(parameters(potential), float(t));
                });
                CHECK(std::fabs(gradient[i] - slope) < 3e-5);
                CHECK(curvature[i] == doctest::Approx(k).epsilon(1e-4));
            }
            CHECK(prior_value(n, f.data()) == doctest::Approx(value).epsilon(1e-5));
        }
}

TEST_CASE("the gradient is the value's derivative along any direction") {
    const std::vector<float> f = volume(2), d = volume(3);
    for (Potential potential : potentials) {
        const Neighbourhood n = neighbourhood(shape, spacing, parameters(potential), 26);
        std::vector<float> gradient(f.size()), curvature(f.size()), up = f, down = f;
        prior_surrogate(n, f.data(), gradient.data(), curvature.data());
        double along = 0;
        const float h = 0.004f;
        for (size_t i = 0; i < f.size(); i++)
            up[i] += h * d[i], down[i] -= h * d[i], along += double(gradient[i]) * d[i];
        CHECK((prior_value(n, up.data()) - prior_value(n, down.data())) / (2 * h) ==
              doctest::Approx(along).epsilon(1e-3));
    }
}

TEST_CASE("a row's sums leave out the neighbour that the sweep has just visited") {
    const std::vector<float> f = volume(4);
    for (Potential potential : potentials)
        for (int neighbours : {6, 26})
            for (bool backwards : {false, true})
                for (int64_t row : {int64_t(0), 2 * shape[1] + 3, shape[0] * shape[1] - 1})
                    for (int64_t begin : {0, 3})
                        for (int64_t end : {int64_t(7), shape[2]}) {
                            const Neighbourhood n = neighbourhood(shape, spacing, parameters(potential), neighbours);
                            std::vector<float> slope(end - begin), curvature(end - begin);
                            prior_of_row(n, f.data(), row / shape[1], row % shape[1], begin, end, backwards,
                                         slope.data(), curvature.data());
                            for (int64_t x = begin; x < end; x++) {
                                const int64_t i = row * shape[2] + x;
                                double s = 0, k = 0;
                                for_neighbours(i, neighbours, [&](int64_t j, double weight) {
                                    if (j == (backwards ? i + 1 : i - 1)) return;
                                    const double t = double(f[i]) - f[j];
                                    const double c = weight * potential_curvature(parameters(potential), float(t));
                                    s += c * t, k += c;
                                });
                                CHECK(std::fabs(slope[x - begin] - s) < 1e-5);
                                CHECK(curvature[x - begin] == doctest::Approx(k).epsilon(1e-5));
                            }
                        }
}
