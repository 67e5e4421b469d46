#pragma once
#include "geometry.h"
#include <vector>

namespace palpate {

// Consecutive slices begin .. end - 1 that the descent takes together, so that what a block of rows reads of the images
// is used for all of them while it is near. Rows `stride` apart share no pixel in any slice, nor do blocks of
// 8·stride rows with another between them, whichever of the slices they lie in.
struct Slab {
    int begin, end, stride;
};

// All slices, from the first on. Where a panel is not parallel to them, each is a slab of its own.
std::vector<Slab> slabs(const Geometry& geometry);

} // namespace palpate
