// A tick of the modes against many small steps, their energy, and their shapes.
#include "compliance/vibration_modes.h"
#include <doctest.h>

using namespace palpate;

namespace {

VibrationModes three(double damping, const RelaxationSpectrum& spectrum = {}) {
    std::vector<float> shape(2 * 3 * 3);
    for (size_t k = 0; k < shape.size(); k++) shape[k] = 0.1f * float(k + 1) - 0.8f;
    return VibrationModes({20, 180, 900}, shape, damping, 2e-3, spectrum);
}

} // namespace

TEST_CASE("a tick is the exact solution for a constant force, elastic or not") {
    for (double damping : {0.0, 0.05, 0.7})
        for (const RelaxationSpectrum& spectrum :
             {RelaxationSpectrum(), RelaxationSpectrum({{0.3, 0.01}, {0.2, 0.2}})}) {
            const VibrationModes modes = three(damping, spectrum);
            ModalMotion motion(modes);
            const double load[3] = {0.3, -2, 1};
            double state[3][4] = {}; // eta, rate, branches
            constexpr int ticks = 5, steps = 20000;
            const double h = RelaxationSpectrum::tick / steps;
            for (int t = 0; t < ticks; t++) motion.advance(load);
            for (int m = 0; m < 3; m++) {
                const double w = modes.frequency[m];
                const auto slopes = [&](const double* x, double* out) {
                    out[0] = x[1];
                    out[1] = load[m] - 2 * damping * w * x[1] - w * w * x[0];
                    for (int k = 0; k < spectrum.terms; k++) {
                        out[1] -= x[2 + k];
                        out[2 + k] = spectrum.ratio[k] * w * w * x[1] - x[2 + k] / spectrum.time[k];
                    }
                };
                for (int s = 0; s < ticks * steps; s++) { // midpoint rule
                    double slope[4] = {}, half[4];
                    slopes(state[m], slope);
                    for (int k = 0; k < 4; k++) half[k] = state[m][k] + h / 2 * slope[k];
                    slopes(half, slope);
                    for (int k = 0; k < 4; k++) state[m][k] += h * slope[k];
                }
                CHECK(motion.eta(m) == doctest::Approx(state[m][0]).epsilon(1e-6));
                CHECK(motion.rate(m) == doctest::Approx(state[m][1]).epsilon(1e-6));
            }
        }
}

TEST_CASE("without damping a body that is left alone keeps its energy, and with damping it comes to rest") {
    const VibrationModes modes = three(0), damped = three(0.05);
    ModalMotion motion(modes), settling(damped);
    const double load[3] = {1, 1, -1};
    motion.advance(load);
    settling.advance(load);
    for (int t = 0; t < 100; t++) motion.advance(nullptr); // what lagged is gone
    const double energy = motion.energy();
    CHECK(energy > 0);
    for (int t = 0; t < 5000; t++) {
        motion.advance(nullptr);
        settling.advance(nullptr);
    }
    CHECK(motion.energy() == doctest::Approx(energy).epsilon(1e-9));
    CHECK_FALSE(motion.at_rest);
    for (int t = 0; t < 25000; t++) settling.advance(nullptr);
    CHECK(settling.at_rest);
    CHECK(settling.energy() == 0);
}

TEST_CASE("the modes' displacement is the sum of their shapes") {
    const VibrationModes modes = three(0);
    const double amplitude[3] = {1, -2, 0.5};
    const float single[3] = {1, -2, 0.5f};
    double one[3], patch[9], both[3];
    float shown[3] = {0, 0, 0};
    modes.displacement(1, amplitude, one);
    modes.add_displacement(1, single, shown);
    for (int c = 0; c < 3; c++) {
        double expected = 0;
        for (int m = 0; m < 3; m++) expected += amplitude[m] * modes.shape[9 + 3 * m + c];
        CHECK(one[c] == doctest::Approx(expected));
        CHECK(shown[c] == doctest::Approx(expected));
    }
    const int nodes[2] = {0, 1};
    const double weight[2] = {0.25, 0.75};
    modes.project(nodes, weight, 2, patch);
    modes.displacement(patch, amplitude, both);
    double zero[3];
    modes.displacement(0, amplitude, zero);
    for (int c = 0; c < 3; c++) CHECK(both[c] == doctest::Approx(0.25 * zero[c] + 0.75 * one[c]));
}
