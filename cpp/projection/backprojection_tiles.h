// Back projection of parallel and oblique views, tile by tile. Called by backproject(); in parallel over tiles.
#pragma once
#include "projection/scan_geometry.h"

namespace palpate {

// Overwrites f with the transpose of project_tiles. images[k]: the measured pixels of a parallel view, which are
// scaled by the rays' path here; the fine image of an oblique view; null for other views.
void backproject_tiles(const ScanGeometry& geometry, const std::vector<const float*>& images, float* f);

} // namespace palpate
