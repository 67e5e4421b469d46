// The negative log-likelihood of transmission data behind a blur of each view, and its derivative.
//
// Counts y have the mean m = b·(K e^-l) + r. K blurs a view by a symmetric kernel along its rows' index and by one
// along its columns'; what lies beyond the panel's edge is 0. Every pixel of l may reach several pixels of y. Source of
// the model: Yu, Fessler & Ficaro, IEEE Trans. Med. Imaging 19:1094 (2000). Called by models/blurred.py; in parallel
// over rows. Two views' worth of memory is allocated in a call.
#pragma once
#include "statistics/transmission_likelihood.h"
#include <cstdint>

namespace palpate {

// taps: (views, 2, reach + 1), from the middle outwards, of the kernel across rows and of that across columns, no unit.
struct PanelBlur {
    const float* taps;
    int64_t views, rows, columns, reach;
};

// K of each view. in, out: (views, rows, columns), not the same.
void blur_views(const PanelBlur& blur, const float* in, float* out);

// Σ m − y + y log(y/m). l: (views, rows, columns), without unit. slope: receives the derivative by l,
// e^-l K[b (y/m − 1)], photons; null if it is not wanted. A pixel with incident 0 was not measured and is left out.
double blurred_value(const Measurements& pixels, const PanelBlur& blur, const float* l, float* slope);

// How −log K e^-l changes as l does along v: K[e^-l v] / K e^-l, a mean of v weighted by the light.
void blurred_direction(const PanelBlur& blur, const float* l, const float* v, float* out);

} // namespace palpate
