// The negative log-likelihood against its formula, its derivative by finite differences, and its parabolas, which touch
// it and lie above it.
#include "statistics/transmission_likelihood.h"
#include <cmath>
#include <doctest.h>
#include <limits>
#include <vector>

using namespace palpate;

namespace {

struct Pixel {
    float counts, incident, background;
};

// The Gaussian's parabolas need a background: read-out noise adds one.
bool bounded(const Pixel& p, Noise noise) { return noise == Noise::poisson || p.background > 0; }

const std::vector<Pixel> pixels = {{900, 5000, 0}, {37, 5000, 12},  {5400, 5000, 30}, {0, 300, 0}, {0, 2e5f, 7},
                                   {1, 40, 3},     {7e4f, 2e5f, 9}, {8, 2e5f, 20},    {20, 10, 15}};

long double formula(const Pixel& p, long double l, Noise noise) {
    const long double y = p.counts, m = p.incident * std::exp(-l) + p.background;
    if (noise == Noise::poisson) return m - y + (y > 0 ? y * std::log(y / m) : 0);
    return (m - y) * (m - y) / (2 * m) + 0.5L * std::log(m / std::max(y, 0.5L));
}

long double derivative(const Pixel& p, long double l, Noise noise) {
    const long double h = 1e-5L * (1 + l);
    return (formula(p, l + h, noise) - formula(p, l - h, noise)) / (2 * h);
}

struct Arrays {
    std::vector<float> counts, incident, background;
    explicit Arrays(const std::vector<Pixel>& all) {
        for (const Pixel& p : all)
            counts.push_back(p.counts), incident.push_back(p.incident), background.push_back(p.background);
    }
    Measurements view() const { return {counts.data(), incident.data(), background.data(), int64_t(counts.size())}; }
};

float curvature(const Pixel& p, float l, Noise noise, Curvature kind) {
    float out;
    transmission_curvature(Arrays({p}).view(), &l, noise, kind, &out);
    return out;
}

} // namespace

TEST_CASE("value and slope are those of the formula") {
    for (Noise noise : {Noise::poisson, Noise::gaussian}) {
        long double sum = 0;
        std::vector<Pixel> many;
        std::vector<float> l;
        for (float at : {0.0f, 0.01f, 0.3f, 1.7f, 4.0f, 9.0f})
            for (const Pixel& p : pixels) {
                many.push_back(p), l.push_back(at);
                sum += formula(p, at, noise);
            }
        const Arrays arrays(many);
        std::vector<float> slope(l.size()), again(l.size());
        CHECK(transmission_value(arrays.view(), l.data(), noise) == doctest::Approx(double(sum)).epsilon(1e-12));
        CHECK(transmission_value_and_slope(arrays.view(), l.data(), noise, again.data()) ==
              doctest::Approx(double(sum)).epsilon(1e-12));
        transmission_slope(arrays.view(), l.data(), noise, slope.data());
        for (size_t i = 0; i < l.size(); i++) {
            const double exact = double(derivative(many[i], l[i], noise)), scale = many[i].incident * 1e-6 + 1e-4;
            CHECK(std::fabs(slope[i] - exact) < 2e-6 * std::fabs(exact) + scale);
            CHECK(again[i] == doctest::Approx(slope[i]).epsilon(1e-5));
        }
    }
}

TEST_CASE("a pixel that was not measured counts nothing, whatever its counts") {
    const float nan = std::numeric_limits<float>::quiet_NaN();
    std::vector<Pixel> with(20, {900, 5000, 10}), without = with;
    with.insert(with.begin() + 5, {nan, 0, nan});
    const std::vector<float> l(21, 1.2f);
    std::vector<float> slope(21), c(21);
    for (Noise noise : {Noise::poisson, Noise::gaussian}) {
        const Arrays a(with), b(without);
        CHECK(transmission_value(a.view(), l.data(), noise) ==
              doctest::Approx(transmission_value(b.view(), l.data(), noise)).epsilon(1e-12));
        transmission_slope(a.view(), l.data(), noise, slope.data());
        transmission_curvature(a.view(), l.data(), noise, Curvature::optimal, c.data());
        CHECK(slope[5] == 0);
        CHECK(c[5] == 0);
        CHECK(c[6] > 0);
    }
}

TEST_CASE("the optimal and the maximum parabola lie above the likelihood") {
    for (Noise noise : {Noise::poisson, Noise::gaussian})
        for (Curvature kind : {Curvature::optimal, Curvature::maximum})
            for (const Pixel& p : pixels)
                for (float at : {0.0f, 5e-4f, 0.02f, 0.4f, 1.5f, 4.0f, 8.0f}) {
                    if (!bounded(p, noise)) continue;
                    const double c = curvature(p, at, noise, kind), h = double(formula(p, at, noise));
                    const double slope =
                        at > 0 ? double(derivative(p, at, noise)) : double(derivative(p, 1e-5L, noise));
                    const double scale = std::fabs(h) + p.incident + p.counts;
                    for (double l = 0; l <= 12; l += 0.05) {
                        const double above =
                            h + slope * (l - at) + 0.5 * c * (l - at) * (l - at) - double(formula(p, l, noise));
                        if (above < -2e-6 * scale) FAIL_CHECK(l << " from " << at << ": " << above << " of " << scale);
                    }
                }
}

TEST_CASE("for counts, no parabola flatter than the optimal one lies above: they meet at l = 0") {
    for (const Pixel& p : pixels)
        for (float at : {0.4f, 1.5f, 4.0f}) {
            const double c = curvature(p, at, Noise::poisson, Curvature::optimal);
            if (c == 0) continue;
            const double at_zero =
                double(formula(p, at, Noise::poisson) - at * derivative(p, at, Noise::poisson)) + 0.5 * c * at * at;
            CHECK(at_zero == doctest::Approx(double(formula(p, 0, Noise::poisson))).epsilon(1e-4).scale(p.incident));
            CHECK(c <= curvature(p, at, Noise::poisson, Curvature::maximum) * (1 + 1e-6));
        }
}

TEST_CASE("the optimal curvature tends to the maximum one at l = 0") {
    for (Noise noise : {Noise::poisson, Noise::gaussian})
        for (const Pixel& p : pixels) {
            if (!bounded(p, noise)) continue;
            const float maximum = curvature(p, 0, noise, Curvature::maximum);
            CHECK(curvature(p, 0, noise, Curvature::optimal) == maximum);
            CHECK(curvature(p, 1.1e-3f, noise, Curvature::optimal) ==
                  doctest::Approx(maximum).epsilon(2e-3).scale(0.01));
        }
}

TEST_CASE("the precomputed curvature is the second derivative where the mean equals the count") {
    for (Noise noise : {Noise::poisson, Noise::gaussian})
        for (const Pixel& p : pixels) {
            if (!(p.counts > p.background && p.counts < p.incident + p.background)) continue;
            const long double l = std::log((long double)p.incident / (p.counts - p.background)), h = 1e-4L;
            const double second =
                double((formula(p, l + h, noise) - 2 * formula(p, l, noise) + formula(p, l - h, noise)) / (h * h));
            CHECK(curvature(p, float(l), noise, Curvature::precomputed) == doctest::Approx(second).epsilon(1e-4));
        }
}

TEST_CASE("least squares: half the weighted squares") {
    const std::vector<float> weight(9000, 0.5f), p(9000, 2.0f), l(9000, 2.75f);
    CHECK(least_squares_value(weight.data(), p.data(), l.data(), 9000) == doctest::Approx(9000 * 0.25 * 0.5625));
}
