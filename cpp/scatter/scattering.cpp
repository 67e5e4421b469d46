#include "scatter/scattering.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr double two_pi = 6.283185307179586;

// The last i with table[i] <= value, and not the very last.
int64_t below(const double* table, int64_t count, double value) {
    const int64_t i = std::upper_bound(table, table + count, value) - table - 1;
    return std::clamp<int64_t>(i, 0, count - 2);
}

} // namespace

Scattered scatter_rayleigh(const Materials& m, int64_t material, double keV, RandomStream& random) {
    const double* integral = m.form_integral + material * m.momenta;
    const double most = keV / keV_angstrom; // x of an angle of 180 degrees
    const int64_t last = below(m.momentum, m.momenta, most);
    auto square = [&](int64_t i) { return m.momentum[i] * m.momentum[i]; };
    const double part = (most * most - square(last)) / (square(last + 1) - square(last));
    const double whole = integral[last] + std::min(part, 1.0) * (integral[last + 1] - integral[last]);
    for (;;) { // x^2 by F^2, which is constant between two nodes; then the rest by rejection
        const double wanted = random.uniform() * whole;
        const int64_t i = below(integral, m.momenta, wanted);
        const double at = (wanted - integral[i]) / (integral[i + 1] - integral[i]);
        const double x2 = square(i) + at * (square(i + 1) - square(i));
        const double cosine = std::max(1 - 2 * x2 / (most * most), -1.0);
        if (2 * random.uniform() <= 1 + cosine * cosine) return {cosine, keV};
    }
}

Scattered scatter_compton(const Materials& m, int64_t material, double keV, RandomStream& random) {
    const double* share = m.incoherent_share + material * m.momenta;
    const double alpha = keV / electron_rest_energy, least = 1 / (1 + 2 * alpha);
    const double first = -std::log(least), second = (1 - least * least) / 2;
    for (;;) { // by composition and rejection (Butcher & Messel, Nucl. Phys. 20:15, 1960)
        const double e = random.uniform() * (first + second) < first
                             ? std::exp(-first * random.uniform())
                             : std::sqrt(least * least + 2 * second * random.uniform());
        const double t = (1 - e) / (alpha * e), sine2 = t * (2 - t); // t = 1 - cosine
        if (random.uniform() > 1 - e * sine2 / (1 + e * e)) continue;
        const double x = keV / keV_angstrom * std::sqrt(t / 2);
        const int64_t i = below(m.momentum, m.momenta, x);
        const double at = std::min((x - m.momentum[i]) / (m.momentum[i + 1] - m.momentum[i]), 1.0);
        if (random.uniform() <= share[i] + at * (share[i + 1] - share[i])) return {1 - t, keV * e};
    }
}

void turn(double d[3], double cosine, RandomStream& random) {
    const double sine = std::sqrt(std::max(0.0, 1 - cosine * cosine)), azimuth = two_pi * random.uniform();
    const double a = sine * std::cos(azimuth), b = sine * std::sin(azimuth);
    const double across = std::sqrt(d[0] * d[0] + d[1] * d[1]);
    double to[3];
    if (across < 1e-9) {
        to[0] = a, to[1] = b, to[2] = d[2] > 0 ? cosine : -cosine;
    } else {
        to[0] = d[0] * cosine + (a * d[0] * d[2] - b * d[1]) / across;
        to[1] = d[1] * cosine + (a * d[1] * d[2] + b * d[0]) / across;
        to[2] = d[2] * cosine - a * across;
    }
    const double inverse = 1 / std::sqrt(to[0] * to[0] + to[1] * to[1] + to[2] * to[2]);
    for (int i = 0; i < 3; i++) d[i] = to[i] * inverse;
}

} // namespace palpate
