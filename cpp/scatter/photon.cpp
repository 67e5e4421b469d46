#include "scatter/photon.h"

namespace palpate {

std::vector<double> largest_attenuation(const Materials& m) {
    std::vector<double> largest(size_t(m.energies), 0.0);
    for (int64_t k = 0; k < m.count; k++)
        for (int64_t i = 0; i < m.energies; i++) {
            const int64_t at = k * m.energies + i;
            largest[size_t(i)] = std::max(largest[size_t(i)], m.photo[at] + m.rayleigh[at] + m.compton[at]);
        }
    return largest;
}

bool follow(const Materials& m, const Body& body, const std::vector<double>& largest, Photon& photon,
            RandomStream& random, double& deposited) {
    if (!body.enter(photon.position, photon.direction)) return true;
    const double lowest = std::exp(m.log_first);
    Materials::Place at = m.place(photon.keV);
    double most = m.read(largest.data(), 0, at);
    for (;;) {
        const double step = -std::log(random.uniform()) / most;
        for (int i = 0; i < 3; i++) photon.position[i] += step * photon.direction[i];
        if (!body.contains(photon.position)) return true;
        const int64_t k = body.material_at(photon.position);
        if (k < 0) continue;
        double u = random.uniform() * most;
        const double rayleigh = m.read(m.rayleigh, k, at), compton = m.read(m.compton, k, at);
        if ((u -= rayleigh) <= 0) {
            turn(photon.direction, scatter_rayleigh(m, k, photon.keV, random).cosine, random);
            photon.order = photon.order ? 3 : 2;
        } else if ((u -= compton) <= 0) {
            const Scattered s = scatter_compton(m, k, photon.keV, random);
            turn(photon.direction, s.cosine, random);
            deposited += photon.keV - s.keV;
            photon.keV = s.keV;
            photon.order = photon.order ? 3 : 1;
            if (photon.keV < lowest) {
                deposited += photon.keV;
                return false;
            }
            at = m.place(photon.keV);
            most = m.read(largest.data(), 0, at);
        } else if (u <= m.read(m.photo, k, at)) {
            deposited += photon.keV;
            return false;
        }
    }
}

} // namespace palpate
