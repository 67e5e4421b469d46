#include "volume/trilinear_resample.h"
#include <cmath>
#include <doctest.h>
#include <vector>

using palpate::InterpolationPoints;

namespace {

// `count` positions from -1 on, `step` apart, in an axis of `old` values.
struct Positions {
    std::vector<int32_t> at;
    std::vector<float> share, weight;
    std::vector<double> position;

    Positions(int old, int count, double step) {
        for (int i = 0; i < count; i++) {
            const double p = i * step - 1, below = std::fmin(std::fmax(std::floor(p), 0), std::fmax(old - 2, 0));
            position.push_back(p);
            at.push_back(int32_t(below));
            share.push_back(float(old == 1 ? 0 : p - below));
            weight.push_back(p >= 0 && p <= old - 1 ? 1 : 0);
        }
    }
    InterpolationPoints points(int old) const {
        return {at.data(), share.data(), weight.data(), old, int64_t(at.size())};
    }
};

} // namespace

TEST_CASE("a trilinear function is interpolated exactly, and outside it is zero") {
    for (int nz : {1, 4}) {
        const int ny = 5, nx = 6;
        const auto f = [](double z, double y, double x) {
            return 2 + z - 3 * y + 0.5 * x + 0.25 * z * y - x * y + 0.125 * x * y * z;
        };
        std::vector<float> values;
        for (int z = 0; z < nz; z++)
            for (int y = 0; y < ny; y++)
                for (int x = 0; x < nx; x++) values.push_back(float(f(z, y, x)));
        const Positions z(nz, 9, 0.5), y(ny, 13, 0.47), x(nx, 11, 0.8);
        std::vector<float> out(9 * 13 * 11);
        palpate::interpolate(values.data(), z.points(nz), y.points(ny), x.points(nx), out.data());
        size_t n = 0;
        for (int k = 0; k < 9; k++)
            for (int j = 0; j < 13; j++)
                for (int i = 0; i < 11; i++) {
                    const bool inside = z.weight[k] > 0 && y.weight[j] > 0 && x.weight[i] > 0;
                    CHECK(out[n++] ==
                          doctest::Approx(inside ? f(z.position[k], y.position[j], x.position[i]) : 0).epsilon(1e-5));
                }
    }
}
