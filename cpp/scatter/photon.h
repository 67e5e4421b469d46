#pragma once
// The history of one photon in a body: flights, absorption, scattering.
#include "scatter/body.h"
#include "scatter/scattering.h"
#include <vector>

namespace palpate {

// order: 0 never scattered, 1 once by Compton, 2 once by Rayleigh, 3 more than once.
struct Photon {
    double position[3], direction[3], keV;
    int order;
};

// Largest attenuation of the materials at each energy, (energies): the flights of Woodcock's method.
std::vector<double> largest_attenuation(const Materials& materials);

// Follows a photon until it has left the body (true; it may have missed it) or has been absorbed (false). Steps are
// those of the densest material, and collisions are real with the probability that the place has (Woodcock et al.,
// ANL-7050, 1965). deposited: keV left in the body.
bool follow(const Materials& materials, const Body& body, const std::vector<double>& largest, Photon& photon,
            RandomStream& random, double& deposited);

} // namespace palpate
