#include "compliance/vibration_modes.h"
#include "base/cpu_dispatch.h"
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace palpate {
namespace {

// out (modes, 3) += weight shape. Numerical kernel.
PALPATE_KERNEL void add_shape(const float* shape, double weight, int n, double* out) {
    for (int k = 0; k < n; k++) out[k] += weight * shape[k];
}

// Numerical kernel.
PALPATE_KERNEL void add_modes(const float* shape, const float* amplitude, int modes, float* out) {
    float sum[3] = {0, 0, 0};
    for (int m = 0; m < modes; m++)
        for (int c = 0; c < 3; c++) sum[c] += amplitude[m] * shape[3 * m + c];
    for (int c = 0; c < 3; c++) out[c] += sum[c];
}

} // namespace

VibrationModes::VibrationModes(std::vector<double> frequencies, std::vector<float> shapes, double damping, double lag)
    : frequency(std::move(frequencies)), shape(std::move(shapes)), kept(std::exp(-tick / lag)) {
    if (count() > most) throw std::invalid_argument("VibrationModes: too many modes");
    for (double w : frequency) {
        const double wd = w * std::sqrt(1 - damping * damping), e = std::exp(-damping * w * tick);
        const double c = e * std::cos(wd * tick), s = e * std::sin(wd * tick);
        a11.push_back(c + damping * w / wd * s);
        a12.push_back(s / wd);
        a21.push_back(-w * w / wd * s);
        a22.push_back(c - damping * w / wd * s);
        flexibility.push_back(1 / (w * w));
        b1.push_back((1 - a11.back()) * flexibility.back());
        b2.push_back(-a21.back() * flexibility.back());
    }
}

void VibrationModes::project(const int* nodes, const double* weight, int n, double* out) const {
    std::fill_n(out, 3 * count(), 0.0);
    for (int i = 0; i < n; i++) add_shape(&shape[3 * size_t(count()) * nodes[i]], weight[i], 3 * count(), out);
}

void VibrationModes::add_compliance(const double* a, const double* b, double C[9]) const {
    for (int m = 0; m < count(); m++) {
        const double part = b1[m] - (1 - kept) * flexibility[m];
        for (int k = 0; k < 9; k++) C[k] += part * a[3 * m + k / 3] * b[3 * m + k % 3];
    }
}

void VibrationModes::displacement(const double* p, const double* amplitude, double out[3]) const {
    std::fill_n(out, 3, 0.0);
    for (int m = 0; m < count(); m++)
        for (int c = 0; c < 3; c++) out[c] += p[3 * m + c] * amplitude[m];
}

void VibrationModes::displacement(int node, const double* amplitude, double out[3]) const {
    std::fill_n(out, 3, 0.0);
    const float* p = &shape[3 * size_t(count()) * node];
    for (int m = 0; m < count(); m++)
        for (int c = 0; c < 3; c++) out[c] += p[3 * m + c] * amplitude[m];
}

void VibrationModes::add_displacement(int node, const float* amplitude, float out[3]) const {
    add_modes(&shape[3 * size_t(count()) * node], amplitude, count(), out);
}

ModalMotion::ModalMotion(const VibrationModes& modes)
    : modes(modes), eta(modes.count(), 0.0), rate(eta), lagging(eta) {}

void ModalMotion::amplitude(double* out) const {
    for (int m = 0; m < modes.count(); m++) out[m] = eta[m] - modes.flexibility[m] * lagging[m];
}

void ModalMotion::free_amplitude(double* out) const {
    for (int m = 0; m < modes.count(); m++)
        out[m] = modes.a11[m] * eta[m] + modes.a12[m] * rate[m] - modes.kept * modes.flexibility[m] * lagging[m];
}

// Without a load it comes to rest when the modes' amplitudes, in roots of N mm, are too small to be seen or felt.
void ModalMotion::advance(const double* load) {
    double size = 0;
    for (int m = 0; m < modes.count(); m++) {
        const double x = eta[m], v = rate[m], f = load ? load[m] : 0;
        eta[m] = modes.a11[m] * x + modes.a12[m] * v + modes.b1[m] * f;
        rate[m] = modes.a21[m] * x + modes.a22[m] * v + modes.b2[m] * f;
        lagging[m] = modes.kept * lagging[m] + (1 - modes.kept) * f;
        size +=
            std::abs(rate[m]) + modes.frequency[m] * (std::abs(eta[m]) + modes.flexibility[m] * std::abs(lagging[m]));
    }
    at_rest = !load && size < 1e-9;
    if (at_rest) reset();
}

double ModalMotion::energy() const {
    double sum = 0;
    for (int m = 0; m < modes.count(); m++)
        sum += rate[m] * rate[m] + (eta[m] * eta[m] / modes.flexibility[m]) -
               modes.flexibility[m] * lagging[m] * lagging[m];
    return 0.5 * sum;
}

void ModalMotion::reset() {
    for (auto* v : {&eta, &rate, &lagging}) std::fill(v->begin(), v->end(), 0.0);
    at_rest = true;
}

} // namespace palpate
