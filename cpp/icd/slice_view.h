// The footprints of the voxels of one slice in one view whose layout is separable. Made for each slice and view by
// icd/coordinate_descent.cpp and read by all its threads.
#pragma once
#include "icd/column_sums.h"
#include "icd/rotated_panel_rows.h"
#include "icd/row_group.h"

namespace palpate {

// What a thread needs for one view of a row group.
struct SliceViewScratch {
    RotatedPanelRow rotated[lanes]; // on rotated panels
    AlignedBuffer rows;             // sums of the columns, row by row
};

class SliceView {
public:
    void make(const ScanGeometry& geometry, const View& view, int z);

    // Sums the images over the group's footprints along y, for the columns under voxels begin .. end - 1.
    void gather(const RowGroup& group, const float* slope, const float* curvature, int begin, int end,
                ColumnSums& columns, SliceViewScratch& scratch) const;
    // slope += curvature · A (change), with the changes that `columns` holds since it was gathered.
    void spread(const RowGroup& group, const ColumnSums& columns, const float* curvature, SliceViewScratch& scratch,
                float* slope) const;

private:
    const View* view = nullptr;
    int64_t stride = 0;
    AxisFootprint along_x, along_y;      // along_y: not on rotated panels
    std::vector<RowEdges> along_columns; // on rotated panels: per term
};

} // namespace palpate
