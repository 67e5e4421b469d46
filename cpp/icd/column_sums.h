// The detector columns under a part of a row group in one view, in which coordinate descent looks up each voxel. One a
// thread and view; filled by SliceView, read and changed by RowUpdate.
#pragma once
#include "base/aligned_buffer.h"
#include "base/simd.h"
#include "icd/axis_footprint.h"

namespace palpate {

// A lane is a row of voxels. With the weights w[pixel][term] of a voxel along x, its curvature is Σ over pixels of
// w' C w and its slope Σ of w' (S + C P): the sums S of slope (one a term) and C of curvature (one a pair of terms) are
// those at the start of the part, and P is Σ of w · change over the voxels updated since.
struct ColumnSums {
    const AxisFootprint* along_x = nullptr;
    int from = 0, n = 0;        // columns; none: no voxel of the part touches the image
    AlignedBuffer sums, change; // (columns; terms, then pairs of terms; lanes), (columns, terms, lanes)

    // Chooses the columns under voxels begin .. end - 1, whole vectors. Nothing has changed yet; sums is only sized.
    void start(const AxisFootprint& along_x, int begin, int end);
};

// Adds the slope and curvature of voxel x in all views.
void add_derivatives(const std::vector<ColumnSums>& views, int x, f32x8& slope, f32x8& curvature);
// Voxel x has changed.
void apply_change(std::vector<ColumnSums>& views, int x, const f32x8& change);

} // namespace palpate
