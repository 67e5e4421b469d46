#pragma once
#include <cstdint>

namespace palpate {

enum class Curvature { precomputed, optimal, maximum };

// Photon counts behind an absorber: mean = incident·e^-l + background. Arrays of one value a pixel, photons; a pixel
// with incident 0 was not measured and carries no weight.
struct Counts {
    const float* counts;
    const float* incident;
    const float* background;
    int64_t size;
};

// Σ m − y + y log(y/m): minus log-likelihood of Poisson counts, zero where the mean equals the count (half the
// deviance).
double transmission_value(const Counts& pixels, const float* l);

// Slope of what transmission_value sums, and the curvature of a parabola in l that touches it. l: (size), >= 0, no
// unit. Erdogan & Fessler, IEEE Trans. Med. Imaging 18:801 (1999).
void transmission_slope(const Counts& pixels, const float* l, float* slope);
void transmission_curvature(const Counts& pixels, const float* l, Curvature kind, float* curvature);

// Σ weight (l − p)²/2 over all pixels.
double least_squares_value(const float* weight, const float* p, const float* l, int64_t size);

} // namespace palpate
