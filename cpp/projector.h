#pragma once
#include "geometry.h"

namespace palpate {

// p (views, rows, columns) = A f: line integrals of f (z, y, x), averaged over each pixel.
void project(const Geometry& geometry, const float* f, float* p);

// f = A' p, the exact transpose.
void backproject(const Geometry& geometry, const float* p, float* f);

} // namespace palpate
