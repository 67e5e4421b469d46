// Forward and back projection of views whose panel is rotated about y. Called by project() and backproject().
#pragma once
#include "projection/footprint_weights.h"

namespace palpate {

// Columns are resampled first, exactly as on a parallel panel; then each column's rows, with its own magnification.
// f: (z, y, x), with x and y exchanged if the view has them exchanged; image: (nb, na), not scaled by the rays' path.
void project_rotated(const ScanGeometry& geometry, const View& view, const float* f, float* image);
void backproject_rotated(const ScanGeometry& geometry, const View& view, const float* image, float* f);

} // namespace palpate
