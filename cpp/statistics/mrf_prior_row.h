// The prior's surrogate for one row of voxels at a time. Called by the coordinate descent, on its threads.
#pragma once
#include "statistics/mrf_prior.h"

namespace palpate {

// Slope and curvature as in prior_surrogate, (end - begin), of voxels begin .. end - 1 of row y in slice z, without the
// neighbour that a sweep along x has visited just before: x - 1, or x + 1 if `backwards`.
void prior_of_row(const Neighbourhood& neighbours, const float* f, int64_t z, int64_t y, int64_t begin, int64_t end,
                  bool backwards, float* slope, float* curvature);

} // namespace palpate
