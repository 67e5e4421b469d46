#pragma once
// The mean transmission of a moving grid of parallel septa.
#include <algorithm>
#include <cmath>
#include <cstdint>

namespace palpate {

struct AntiscatterGrid {
    double height, septum, interspace;                         // mm; height 0: no grid
    const double *septum_attenuation, *interspace_attenuation; // (energies) 1/mm, at those of Materials
};

// tangent: of the photon's angle to the septa, across them; slant: 1 / cosine of its angle to the panel's normal. The
// mean over all positions of the septa: the overlap of the path's shift with the septa is a trapezoid in position
// (after Day & Dance, Phys. Med. Biol. 28:1429, 1983).
inline double grid_transmission(const AntiscatterGrid& g, double septum_mu, double interspace_mu, double tangent,
                                double slant) {
    const double period = g.septum + g.interspace, path = g.height * slant;
    const double shift = g.height * std::abs(tangent), whole = std::floor(shift / period), s = shift - whole * period;
    const double open = std::exp(-interspace_mu * path), extra = (septum_mu - interspace_mu) * path;
    if (shift < 1e-9 * period) return open * (g.interspace + g.septum * std::exp(-extra)) / period;
    const double k = extra / shift; // per mm of shift that lies in septa
    const double least = whole * g.septum + std::max(0.0, s - g.interspace);
    const double most = whole * g.septum + std::min(s, g.septum);
    const double ramp = most - least;
    const double sum =
        std::abs(g.septum - s) * std::exp(-k * most) + std::abs(g.interspace - s) * std::exp(-k * least) +
        2 * (k * ramp < 1e-9 ? ramp * std::exp(-k * least) : (std::exp(-k * least) - std::exp(-k * most)) / k);
    return open * sum / period;
}

} // namespace palpate
