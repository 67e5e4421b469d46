// The negative log-likelihood of transmission data, its derivative, and curvatures of its paraboloidal surrogates.
// Erdogan & Fessler, IEEE Trans. Med. Imaging 18:801 (1999). Called by every likelihood method; in parallel over
// pixels.
#pragma once
#include <cstdint>

namespace palpate {

// Of the parabola: the second derivative where the mean equals the count; the smallest for which the parabola lies
// above the likelihood; the largest second derivative.
enum class Curvature { precomputed, optimal, maximum };

// The distribution of a pixel about its mean m: Poisson, or normal with variance m. The latter models an integrating
// panel, after its read-out noise σ² has been added to both y and r; its curvatures need a background r > 0.
enum class Noise { poisson, gaussian };

// Photon counts y with mean m = b·e^-l + r: b incident, r background. One value a pixel. A pixel with incident 0 was
// not measured and is left out.
struct Measurements {
    const float* counts;
    const float* incident;
    const float* background;
    int64_t size;
};

// The negative log-likelihood, zero where the mean equals the count. Poisson: Σ m − y + y log(y/m), half the deviance.
// Gaussian: Σ (m − y)²/2m + ½ log(m/y). l: (size), >= 0, line integrals without unit.
double transmission_value(const Measurements& pixels, const float* l, Noise noise);

// The derivative in l of each pixel's term, and the curvature of a parabola that touches it at l.
void transmission_slope(const Measurements& pixels, const float* l, Noise noise, float* slope);
double transmission_value_and_slope(const Measurements& pixels, const float* l, Noise noise,
                                    float* slope); // in one pass
void transmission_curvature(const Measurements& pixels, const float* l, Noise noise, Curvature kind, float* curvature);

// Σ weight (l − p)²/2 over all pixels.
double least_squares_value(const float* weight, const float* p, const float* l, int64_t size);

} // namespace palpate
