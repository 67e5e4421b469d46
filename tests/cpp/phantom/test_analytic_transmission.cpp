#include "phantom/analytic_transmission.h"
#include <cmath>
#include <doctest.h>
#include <vector>

using namespace palpate;

namespace {

const double source[3] = {3, -4, 100};

// One ray to each of 5 x 7 points, 6 mm apart on the plane z = -20.
std::vector<double> pass(const std::vector<std::vector<double>>& solids, const std::vector<int64_t>& kinds,
                         const std::vector<int64_t>& first, const std::vector<double>& attenuation) {
    const double origin[3] = {-18, -12, -20}, down[3] = {0, 6, 0}, right[3] = {6, 0, 0};
    std::vector<double> numbers, out(35);
    for (auto solid : solids) {
        solid.resize(Solids::numbers);
        numbers.insert(numbers.end(), solid.begin(), solid.end());
    }
    std::vector<int64_t> ranges;
    for (size_t i = 0; i < attenuation.size(); i++) ranges.insert(ranges.end(), {0, 4, 0, 6});
    transmission(
        {first.data(), attenuation.data(), ranges.data(), kinds.data(), numbers.data(), int64_t(attenuation.size())},
        {source, origin, down, right, 5, 7, 1}, out.data());
    return out;
}

// Length of the ray to point (row, column) where `inside` holds, by small steps.
template <class Inside> double length(int row, int column, Inside inside) {
    const double end[3] = {-18.0 + 6 * column, -12.0 + 6 * row, -20},
                 d[3] = {end[0] - source[0], end[1] - source[1], end[2] - source[2]};
    constexpr int steps = 100000;
    int count = 0;
    for (int i = 0; i < steps; i++) {
        const double t = (i + 0.5) / steps;
        count += inside(source[0] + t * d[0], source[1] + t * d[1], source[2] + t * d[2]);
    }
    return count * std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) / steps;
}

} // namespace

TEST_CASE("rays through an ellipsoid, a box and their intersection are attenuated by the length inside") {
    // an ellipsoid of radii 9, 6, 12 about (1, 2, 10); a box
    const std::vector<double> ellipsoid = {1 / 9.0, 0, 0, 0, 1 / 6.0, 0, 0, 0, 1 / 12.0, 1, 2, 10},
                              box = {-5, -8, 4, 6, 7, 15};
    const auto in_ellipsoid = [](double x, double y, double z) {
        return std::pow((x - 1) / 9, 2) + std::pow((y - 2) / 6, 2) + std::pow((z - 10) / 12, 2) < 1;
    };
    const auto in_box = [](double x, double y, double z) {
        return x > -5 && x < 6 && y > -8 && y < 7 && z > 4 && z < 15;
    };
    const std::vector<double> one = pass({ellipsoid}, {0}, {0, 1}, {0.02}), other = pass({box}, {1}, {0, 1}, {0.03}),
                              both = pass({ellipsoid, box}, {0, 1}, {0, 2}, {0.05}),
                              sum = pass({ellipsoid, box}, {0, 1}, {0, 1, 2}, {0.02, 0.03});
    int hit = 0;
    for (int row = 0; row < 5; row++)
        for (int column = 0; column < 7; column++) {
            const int i = row * 7 + column;
            const double p = length(row, column, in_ellipsoid), q = length(row, column, in_box);
            const double r = length(
                row, column, [&](double x, double y, double z) { return in_ellipsoid(x, y, z) && in_box(x, y, z); });
            hit += r > 1;
            CHECK(one[i] == doctest::Approx(std::exp(-0.02 * p)).epsilon(1e-4));
            CHECK(other[i] == doctest::Approx(std::exp(-0.03 * q)).epsilon(1e-4));
            CHECK(both[i] == doctest::Approx(std::exp(-0.05 * r)).epsilon(1e-4));
            CHECK(sum[i] == doctest::Approx(one[i] * other[i]).epsilon(1e-12));
        }
    CHECK(hit >= 3);
}
