#pragma once
#include "prior.h"

namespace palpate {

// What the prior says of voxels begin .. end - 1 of row y in slice z, from all their neighbours but the one that a
// sweep along x, `backwards` or not, has visited just before: slope and curvature as in prior_surrogate, (end - begin).
void prior_of_row(const Neighbourhood& neighbours, const float* f, int64_t z, int64_t y, int64_t begin, int64_t end,
                  bool backwards, float* slope, float* curvature);

} // namespace palpate
