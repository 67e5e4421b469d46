#pragma once
#include <cstdint>

namespace palpate {

enum class Curvature { precomputed, optimal, maximum };

// How a pixel scatters about its mean m: as counts do, or normally with variance m. The latter is what an integrating
// panel shows once its read-out noise σ² has been added to both y and r (see scans/readout.py).
enum class Noise { poisson, gaussian };

// Photon counts behind an absorber: mean = incident·e^-l + background. Arrays of one value a pixel, photons; a pixel
// with incident 0 was not measured and carries no weight.
struct Counts {
    const float* counts;
    const float* incident;
    const float* background;
    int64_t size;
};

// Minus log-likelihood, zero where the mean equals the count. Poisson: Σ m − y + y log(y/m), half the deviance.
// Gaussian: Σ (m − y)²/2m + ½ log(m/y).
double transmission_value(const Counts& pixels, const float* l, Noise noise);

// Slope of what transmission_value sums, and the curvature of a parabola in l that touches it. l: (size), >= 0, no
// unit. Erdogan & Fessler, IEEE Trans. Med. Imaging 18:801 (1999).
void transmission_slope(const Counts& pixels, const float* l, Noise noise, float* slope);
double transmission_value_and_slope(const Counts& pixels, const float* l, Noise noise, float* slope); // in one pass
void transmission_curvature(const Counts& pixels, const float* l, Noise noise, Curvature kind, float* curvature);

// Σ weight (l − p)²/2 over all pixels.
double least_squares_value(const float* weight, const float* p, const float* l, int64_t size);

} // namespace palpate
