// How accurately footprints are made: the number of sub-slices of a slice, of Legendre moments of a sub-slice, and the
// truncation of small weights. Called once for a geometry, before the first projection; its views in parallel.
#pragma once
#include "projection/scan_geometry.h"

namespace palpate {

// Sets sub-slices, moments and truncation of each view (see AxisWeights): the fewest products of 1-D weights at which a
// projection of independent voxel values, uniform in [0, 1], errs by less than the geometry's tolerance (relative L2).
// Measured, not modelled: the footprints of sample voxels are compared with those of many sub-slices.
void choose_subslices(ScanGeometry& geometry);

} // namespace palpate
