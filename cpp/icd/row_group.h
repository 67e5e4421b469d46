// The rows of voxels that coordinate descent updates at once. Used by every file of icd/, on any thread.
#pragma once
#include "base/simd.h"

namespace palpate {

constexpr int voxels_at_once = 64; // of each row, along x

// Up to eight rows of voxels of one slice that share no pixel, one a lane.
struct RowGroup {
    int rows = 0;
    int y[lanes];
};

} // namespace palpate
