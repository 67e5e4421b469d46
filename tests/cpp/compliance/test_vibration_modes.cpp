// A tick of the modes against many small steps, their energy, and a model of a few modes against the dense body.
#include "../random_blocks.h"
#include "compliance/compliance_model.h"
#include <doctest.h>
#include <numeric>

using namespace palpate;

namespace {

VibrationModes three(double damping, const RelaxationSpectrum& spectrum = {}) {
    std::vector<float> shape(2 * 3 * 3);
    for (size_t k = 0; k < shape.size(); k++) shape[k] = 0.1f * float(k + 1) - 0.8f;
    return VibrationModes({20, 180, 900}, shape, damping, 2e-3, spectrum);
}

} // namespace

TEST_CASE("a tick is the exact solution for a constant force") {
    for (double damping : {0.0, 0.05, 0.7}) {
        const VibrationModes modes = three(damping);
        ModalMotion motion(modes);
        const double load[3] = {0.3, -2, 1};
        double eta[3] = {}, rate[3] = {};
        for (int tick = 0; tick < 5; tick++) {
            motion.advance(load);
            constexpr int steps = 20000;
            const double h = RelaxationSpectrum::tick / steps;
            for (int m = 0; m < 3; m++)
                for (int s = 0; s < steps; s++) { // midpoint
                    const double w = modes.frequency[m];
                    const auto slope = [&](double x, double v) { return load[m] - 2 * damping * w * v - w * w * x; };
                    const double x = eta[m] + h / 2 * rate[m], v = rate[m] + h / 2 * slope(eta[m], rate[m]);
                    rate[m] += h * slope(x, v);
                    eta[m] += h * v;
                }
            for (int m = 0; m < 3; m++) {
                CHECK(motion.eta(m) == doctest::Approx(eta[m]).epsilon(1e-6));
                CHECK(motion.rate(m) == doctest::Approx(rate[m]).epsilon(1e-6));
            }
        }
    }
}

TEST_CASE("nor does a stiffness that relaxes keep it from being exact") {
    RelaxationSpectrum spectrum;
    spectrum.add(0.3, 0.01, 0.5);
    spectrum.add(0.2, 0.2, 0.5);
    const double times[2] = {0.01, 0.2};
    const VibrationModes modes = three(0.05, spectrum);
    ModalMotion motion(modes);
    const double load[3] = {0.3, -2, 1};
    double eta[3] = {}, rate[3] = {}, branch[3][2] = {};
    for (int tick = 0; tick < 5; tick++) {
        motion.advance(load);
        constexpr int steps = 20000;
        const double h = RelaxationSpectrum::tick / steps;
        for (int m = 0; m < 3; m++)
            for (int s = 0; s < steps; s++) { // midpoint
                const double w = modes.frequency[m];
                const auto slopes = [&](double x, double v, const double* b, double* out) {
                    out[0] = v;
                    out[1] = load[m] - 2 * 0.05 * w * v - w * w * x - b[0] - b[1];
                    for (int k = 0; k < 2; k++) out[2 + k] = spectrum.ratio[k] * w * w * v - b[k] / times[k];
                };
                double first[4], middle[4];
                slopes(eta[m], rate[m], branch[m], first);
                const double half[2] = {branch[m][0] + h / 2 * first[2], branch[m][1] + h / 2 * first[3]};
                slopes(eta[m] + h / 2 * first[0], rate[m] + h / 2 * first[1], half, middle);
                eta[m] += h * middle[0];
                rate[m] += h * middle[1];
                for (int k = 0; k < 2; k++) branch[m][k] += h * middle[2 + k];
            }
        for (int m = 0; m < 3; m++) {
            CHECK(motion.eta(m) == doctest::Approx(eta[m]).epsilon(1e-6));
            CHECK(motion.rate(m) == doctest::Approx(rate[m]).epsilon(1e-6));
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
