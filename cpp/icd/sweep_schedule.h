// Which rows of voxels coordinate descent may update at once. Made for each sweep by icd/coordinate_descent.cpp.
#pragma once
#include "projection/scan_geometry.h"
#include <vector>

namespace palpate {

// Consecutive slices begin .. end - 1 that a sweep takes together, so that the part of the images that a block of rows
// reads stays in the cache for all of them. Rows `stride` apart share no pixel in any slice, nor do blocks of 8·stride
// rows with another between them, whichever of the slices they lie in.
struct Slab {
    int begin, end, stride;
};

// All slices, from the first on. Where a panel is not parallel to them, each is a slab of its own.
std::vector<Slab> slabs(const ScanGeometry& geometry);

} // namespace palpate
