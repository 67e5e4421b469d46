#pragma once
#include "geometry.h"

namespace palpate {

// Writes image[k] of each view k that has one (panels parallel to the slices, and tilted ones): the separable part of
// A, scaled by the rays' path and at the measured pixels, or on a tilted view's fine image as it is.
void project_tiles(const Geometry& geometry, const float* f, const std::vector<float*>& images);

} // namespace palpate
