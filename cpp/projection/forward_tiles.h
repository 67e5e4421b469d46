// Forward projection of parallel and oblique views, tile by tile. Called by project(); in parallel over tiles.
#pragma once
#include "projection/scan_geometry.h"

namespace palpate {

// Writes image[k] of each view k that has one. On a parallel panel these are the measured pixels, scaled by the rays'
// path; on an oblique panel the fine image, not scaled. add: to what the measured pixels hold, instead of writing them.
void project_tiles(const ScanGeometry& geometry, const float* f, const std::vector<float*>& images, bool add);

} // namespace palpate
