#include "base/vector_math.h"
#include <cmath>
#include <doctest.h>
#include <initializer_list>

using namespace palpate;

TEST_CASE("fast_exp is exp to 2 units in the last place") {
    double worst = 0;
    for (double x = -700; x <= 700; x += 0.0371) worst = std::fmax(worst, std::fabs(fast_exp(x) / std::exp(x) - 1));
    for (double x = -1; x <= 1; x += 1e-4) worst = std::fmax(worst, std::fabs(fast_exp(x) / std::exp(x) - 1));
    CHECK(worst < 4.5e-16);
    CHECK(fast_exp(0) == 1);
    CHECK(fast_exp(-5000) == fast_exp(-700));
    CHECK(fast_exp(5000) == fast_exp(700));
}

TEST_CASE("fast_expm1 is exp - 1 to 4 units in the last place, near 0 too") {
    double worst = 0;
    for (double x = -30; x <= 700; x += 0.0371) worst = std::fmax(worst, std::fabs(fast_expm1(x) / std::expm1(x) - 1));
    for (double power = -300; power <= 0; power += 0.0173)
        for (double x : {std::pow(10, power), -std::pow(10, power)})
            worst = std::fmax(worst, std::fabs(fast_expm1(x) / std::expm1(x) - 1));
    CHECK(worst < 8.9e-16);
    CHECK(fast_expm1(0) == 0);
    CHECK(fast_expm1(-5000) == -1);
    CHECK(fast_expm1(5000) == fast_expm1(700));
}

TEST_CASE("fast_log is log to 3 units in the last place of 1 + |log|") {
    double worst = 0;
    for (double power = -300; power <= 300; power += 0.0173) {
        const double x = std::pow(10, power), exact = std::log(x);
        worst = std::fmax(worst, std::fabs(fast_log(x) - exact) / (1 + std::fabs(exact)));
    }
    for (double x = 0.5; x <= 2; x += 1e-4) worst = std::fmax(worst, std::fabs(fast_log(x) - std::log(x)));
    CHECK(worst < 6.7e-16);
    CHECK(fast_log(1) == 0);
}

TEST_CASE("fast_power is pow to 2e-7 (1 + |power|)") {
    double worst = 0;
    for (double exponent = -6; exponent <= 6; exponent += 0.0191)
        for (float power : {-2.0f, -0.5f, 0.0f, 0.3f, 0.8f, 1.0f, 2.5f}) {
            const auto x = float(std::pow(10, exponent));
            const double exact = std::pow(double(x), double(power));
            // log2 of x is rounded to float: its error grows with it
            const double scale = 1 + std::fabs(power) * (1 + std::fabs(exponent));
            worst = std::fmax(worst, std::fabs(fast_power(x, power) / exact - 1) / scale);
        }
    CHECK(worst < 3e-7);
}
