#pragma once
#include "geometry.h"

namespace palpate {

// Chooses a view's sub-slices and moments (see AxisWeights): the fewest products at which a view of independent voxel
// values, uniform in [0, 1], errs by less than the geometry's tolerance (relative L2). Measured, not modelled: the
// footprints of sample voxels against those of many sub-slices.
void cut(const Geometry& geometry, View& view);

} // namespace palpate
