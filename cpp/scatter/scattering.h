#pragma once
// The angle and the energy of a photon after it has been scattered by an atom.
#include "scatter/materials.h"
#include "scatter/random_stream.h"

namespace palpate {

struct Scattered {
    double cosine, keV;
};

// Rayleigh: Thomson's (1 + cos^2)/2 times F^2(x). Energy stays.
Scattered scatter_rayleigh(const Materials& materials, int64_t material, double keV, RandomStream& random);

// Compton: Klein & Nishina's cross section times the incoherent scattering function S(x); electrons at rest.
Scattered scatter_compton(const Materials& materials, int64_t material, double keV, RandomStream& random);

// Turns a unit vector by an angle of that cosine, about itself by a random azimuth.
void turn(double direction[3], double cosine, RandomStream& random);

} // namespace palpate
