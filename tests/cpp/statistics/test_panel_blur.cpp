// Blurred counts against sums over all pairs of pixels, and the derivative by finite differences.
#include "statistics/panel_blur.h"
#include <cmath>
#include <doctest.h>
#include <vector>

using namespace palpate;

namespace {

constexpr int views = 2, rows = 5, columns = 11, reach = 2, size = rows * columns;
// Across rows, then across columns, of each view.
const std::vector<float> taps = {0.6f, 0.15f, 0.05f, 0.4f, 0.2f, 0.1f, 0.8f, 0.1f, 0.0f, 0.5f, 0.15f, 0.1f};
const PanelBlur blur = {taps.data(), views, rows, columns, reach};

float tap(int view, int axis, int distance) {
    return std::abs(distance) > reach ? 0 : taps[(view * 2 + axis) * (reach + 1) + std::abs(distance)];
}

std::vector<float> wavy(double low, double high, double phase) {
    std::vector<float> out(views * size);
    for (size_t i = 0; i < out.size(); i++)
        out[i] = float(low + (high - low) * (0.5 + 0.5 * std::sin(1.7 * double(i) + phase)));
    return out;
}

double weight(int view, int i, int j) {
    return double(tap(view, 0, i / columns - j / columns)) * tap(view, 1, i % columns - j % columns);
}

double value(const std::vector<float>& y, const std::vector<float>& b, const std::vector<float>& r,
             const std::vector<double>& l) {
    double total = 0;
    for (int view = 0; view < views; view++)
        for (int i = 0; i < size; i++) {
            const int at = view * size + i;
            double light = 0;
            for (int j = 0; j < size; j++) light += weight(view, i, j) * std::exp(-l[view * size + j]);
            const double m = b[at] * light + r[at];
            if (b[at] > 0) total += m - y[at] + (y[at] > 0 ? y[at] * std::log(y[at] / m) : 0);
        }
    return total;
}

} // namespace

TEST_CASE("a blur is the sum over all pairs of pixels, with nothing beyond the edge") {
    const auto in = wavy(0, 3, 0.3);
    std::vector<float> out(in.size());
    blur_views(blur, in.data(), out.data());
    for (int view = 0; view < views; view++)
        for (int i = 0; i < size; i++) {
            double sum = 0;
            for (int j = 0; j < size; j++) sum += weight(view, i, j) * in[view * size + j];
            CHECK(out[view * size + i] == doctest::Approx(sum).epsilon(1e-5));
        }
}

TEST_CASE("value and slope are those of the blurred mean, without the pixels that were not measured") {
    auto y = wavy(0, 900, 1), b = wavy(500, 1500, 2), r = wavy(0, 40, 3), l = wavy(0, 4, 4);
    y[3] = 0;
    b[7] = b[60] = 0;
    const std::vector<double> at(l.begin(), l.end());
    std::vector<float> slope(l.size());
    const Measurements pixels = {y.data(), b.data(), r.data(), int64_t(y.size())};
    CHECK(blurred_value(pixels, blur, l.data(), slope.data()) == doctest::Approx(value(y, b, r, at)).epsilon(1e-6));
    CHECK(blurred_value(pixels, blur, l.data(), nullptr) == doctest::Approx(value(y, b, r, at)).epsilon(1e-6));
    for (size_t i = 0; i < l.size(); i++) {
        auto up = at, down = at;
        up[i] += 1e-4, down[i] -= 1e-4;
        const double expected = (value(y, b, r, up) - value(y, b, r, down)) / 2e-4;
        CHECK(slope[i] == doctest::Approx(expected).epsilon(1e-4).scale(10));
    }
}

TEST_CASE("a change of the line integrals is seen as a mean weighted by the light") {
    const auto l = wavy(0, 4, 5), v = wavy(-1, 1, 6);
    std::vector<float> out(l.size());
    blurred_direction(blur, l.data(), v.data(), out.data());
    for (int view = 0; view < views; view++)
        for (int i = 0; i < size; i++) {
            double light = 0, change = 0;
            for (int j = 0; j < size; j++) {
                const double e = weight(view, i, j) * std::exp(-double(l[view * size + j]));
                light += e;
                change += e * v[view * size + j];
            }
            CHECK(out[view * size + i] == doctest::Approx(change / light).epsilon(1e-4).scale(1));
        }
}
