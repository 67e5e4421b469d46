#pragma once
#include "weights.h"

namespace palpate {

// A view whose panel is turned about y: columns are resampled first, exactly as on a parallel panel, then each column's
// rows with its own magnification. `f` is (z, y, x) as the view sees it (View::swapped); `image` is (nb, na).
void project_turned(const Geometry& geometry, const View& view, const float* f, float* image);
void backproject_turned(const Geometry& geometry, const View& view, const float* image, float* f);

} // namespace palpate
