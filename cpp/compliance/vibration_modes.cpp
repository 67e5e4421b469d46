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

constexpr int most_size = VibrationModes::most_width + 1;

// out = exp(A time) of an n x n matrix: the Taylor series of a short time, squared.
void exponential(const double* A, int n, double time, double* out) {
    constexpr int squarings = 12, terms = 10;
    const double h = std::ldexp(time, -squarings);
    double term[most_size * most_size], next[most_size * most_size];
    const auto multiply = [n](const double* a, const double* b, double scale, double* to) {
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) {
                double sum = 0;
                for (int k = 0; k < n; k++) sum += a[i * n + k] * b[k * n + j];
                to[i * n + j] = scale * sum;
            }
    };
    // exp(A h) - 1, so that squaring loses no digits: (1 + x)^2 - 1 = 2 x + x x.
    for (int k = 0; k < n * n; k++) out[k] = term[k] = h * A[k];
    for (int t = 2; t <= terms; t++) {
        multiply(term, A, h / t, next);
        for (int k = 0; k < n * n; k++) out[k] += term[k] = next[k];
    }
    for (int s = 0; s < squarings; s++) {
        multiply(out, out, 1, next);
        for (int k = 0; k < n * n; k++) out[k] = 2 * out[k] + next[k];
    }
    for (int k = 0; k < n; k++) out[k * n + k] += 1;
}

} // namespace

VibrationModes::VibrationModes(std::vector<double> frequencies, std::vector<float> shapes, double damping, double lag,
                               const RelaxationSpectrum& spectrum)
    : frequency(std::move(frequencies)), shape(std::move(shapes)), width(2 + spectrum.terms),
      loads(LoadRecursion::of(spectrum, std::exp(-RelaxationSpectrum::tick / lag))) {
    if (count() > most) throw std::invalid_argument("VibrationModes: too many modes");
    for (double w : frequency) {
        flexibility.push_back(1 / (w * w));
        double A[most_size * most_size] = {}, e[most_size * most_size]; // of the state, and a constant load
        const int n = width + 1;
        A[1] = 1;
        A[n] = -w * w;
        A[n + 1] = -2 * damping * w;
        A[n + n - 1] = 1;
        for (int k = 0; k < spectrum.terms; k++) {
            A[n + 2 + k] = -1;
            A[(2 + k) * n + 1] = spectrum.ratio[k] * w * w;
            A[(2 + k) * n + 2 + k] = -1 / spectrum.time[k];
        }
        exponential(A, n, RelaxationSpectrum::tick, e);
        for (int r = 0; r < width; r++) {
            step.insert(step.end(), e + r * n, e + r * n + width);
            drive.push_back(e[r * n + width]);
        }
    }
}

void VibrationModes::project(const int* nodes, const double* weight, int n, double* out) const {
    std::fill_n(out, 3 * count(), 0.0);
    for (int i = 0; i < n; i++) add_shape(&shape[3 * size_t(count()) * nodes[i]], weight[i], 3 * count(), out);
}

void VibrationModes::add_compliance(const double* a, const double* b, double C[9]) const {
    for (int m = 0; m < count(); m++) {
        const double part = drive[size_t(width) * m] - loads.drive[0] * flexibility[m];
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
    : modes(modes), state(size_t(modes.width) * modes.count(), 0.0),
      lagging(size_t(modes.loads.fields) * modes.count(), 0.0) {}

void ModalMotion::amplitude(double* out) const {
    for (int m = 0; m < modes.count(); m++)
        out[m] = eta(m) - modes.flexibility[m] * lagging[size_t(modes.loads.fields) * m];
}

void ModalMotion::free_amplitude(double* out) const {
    const int width = modes.width, fields = modes.loads.fields;
    for (int m = 0; m < modes.count(); m++) {
        double swing = 0, load = 0;
        for (int k = 0; k < width; k++)
            swing += modes.step[size_t(width) * width * m + k] * state[size_t(width) * m + k];
        for (int k = 0; k < fields; k++) load += modes.loads.step[0][k] * lagging[size_t(fields) * m + k];
        out[m] = swing - modes.flexibility[m] * load;
    }
}

// Without a load it comes to rest when the modes' amplitudes, in roots of N mm, are too small to be seen or felt.
void ModalMotion::advance(const double* load) {
    const int width = modes.width, fields = modes.loads.fields;
    double size = 0;
    for (int m = 0; m < modes.count(); m++) {
        const double f = load ? load[m] : 0, w = modes.frequency[m];
        double *x = &state[size_t(width) * m], *q = &lagging[size_t(fields) * m], next[VibrationModes::most_width];
        for (int r = 0; r < width; r++) {
            next[r] = modes.drive[size_t(width) * m + r] * f;
            for (int k = 0; k < width; k++) next[r] += modes.step[(size_t(m) * width + r) * width + k] * x[k];
        }
        std::copy_n(next, width, x);
        for (int r = 0; r < fields; r++) {
            next[r] = modes.loads.drive[r] * f;
            for (int k = 0; k < fields; k++) next[r] += modes.loads.step[r][k] * q[k];
        }
        std::copy_n(next, fields, q);
        size += std::abs(x[1]) + w * std::abs(x[0]);
        for (int k = 2; k < width; k++) size += std::abs(x[k]) / w;
        for (int k = 0; k < fields; k++) size += std::abs(q[k]) / w;
    }
    at_rest = !load && size < 1e-9;
    if (at_rest) reset();
}

double ModalMotion::energy() const {
    const int width = modes.width, fields = modes.loads.fields;
    double sum = 0;
    for (int m = 0; m < modes.count(); m++) {
        const double soft = modes.flexibility[m];
        sum += rate(m) * rate(m) + eta(m) * eta(m) / soft;
        for (int k = 2; k < width; k++) {
            const double h = state[size_t(width) * m + k];
            sum += h * h * soft / modes.loads.share[k - 1];
        }
        for (int k = 0; k < fields; k++) {
            const double q = lagging[size_t(fields) * m + k];
            sum -= q * q * soft / modes.loads.share[k];
        }
    }
    return 0.5 * sum;
}

void ModalMotion::reset() {
    std::fill(state.begin(), state.end(), 0.0);
    std::fill(lagging.begin(), lagging.end(), 0.0);
    at_rest = true;
}

} // namespace palpate
