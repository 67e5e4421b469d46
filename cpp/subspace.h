#pragma once
#include "prior.h"
#include <cstdint>

namespace palpate {

// What a memory-gradient step needs beside projections: the objective's parabola in the plane of two directions, the
// new one u and the last step p (Chouzenoux, Idier & Moussaoui, IEEE Trans. Image Process. 20:1517, 2011). Volumes are
// (nz, ny, nx), sums are made block by block, so that they do not depend on the number of threads.

// Σ over pairs of ω ψ'(t)/t · (Δu², Δu Δp, Δp²): the bends of a parabola above the prior at f, p = f − previous.
void prior_bends(const Neighbourhood& n, const float* f, const float* previous, const float* u, double bends[3]);

// Σ_i curvature_i · (q_i², q_i s_i, s_i²), q = A u, s = l − l_previous.
void data_bends(const float* curvature, const float* l, const float* previous, const float* q, int64_t size,
                double bends[3]);

// The scaled direction u = −g / (data + 2β bend) with g = gradient + β slope; 0 where f is 0 and would sink, or where
// nothing is known. slopes: g·u and g·p.
struct Prediction {
    const float *gradient, *slope, *bend, *data; // of the data, of the prior (two), and Σ_j of the data's curvature
    float beta;
};
void steer(const Prediction& at, const float* f, const float* previous, int64_t size, float* u, double slopes[2]);

// moved = [f + w0 u + w1 (f − previous)]₊.
void advance(const float* f, const float* previous, const float* u, const double w[2], int64_t size, float* moved);

} // namespace palpate
