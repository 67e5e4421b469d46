#pragma once
#include "geometry.h"

namespace palpate {

// Writes all of f with what the separable views add to it: the transpose of project_tiles. images[k] of those views:
// their measured pixels, which get the rays' path here, or a tilted view's fine image as it is; null: not one of them.
void backproject_tiles(const Geometry& geometry, const std::vector<const float*>& images, float* f);

} // namespace palpate
