#pragma once
#include "lanes.h"
#include "terms.h"
#include "turned_rows.h"

namespace palpate {

// Up to eight rows of voxels of one slice that share no pixel, one a lane.
struct Strip {
    int rows = 0;
    int y[lanes];
};

// A view's image with its rows weighed and added up under a strip. In cell c, eight lanes each: for every term the
// column's sum of slope, for every pair of terms its sum of curvature, for every term the sum over the voxels of (along
// x) x change. All are of the columns alone, so that along x a strip is a problem in one dimension.
struct Sums {
    int begin = 0, end = 0;         // columns of the cells
    std::vector<float> cells, rows; // rows: scratch, the same before it is turned into lanes
    TurnedRow turned[lanes];        // on turned panels
};

// The footprints of the voxels of one slice in one view whose layout is separable.
class SliceView {
public:
    void make(const Geometry& geometry, const View& view, int z);
    int rows_apart() const; // rows of voxels this far apart share no pixel, nor does the work on one touch the other's
    int terms() const { return along_x.terms; }
    int cell() const { return (along_x.stride() + along_x.terms) * lanes; } // floats
    const AxisTerms& x() const { return along_x; }

    // Fills the cells that voxels begin .. end - 1 touch.
    void gather(const Strip& strip, const float* slope, const float* curvature, int begin, int end, Sums& sums) const;
    // slope += curvature · A (change), from the changes in those cells.
    void spread(const Strip& strip, const float* curvature, Sums& sums, float* slope) const;

private:
    const View* view = nullptr;
    int64_t stride = 0;
    int ny = 0;
    AxisTerms along_x, along_y;       // x, y of the volume; along_y is unused on turned panels
    std::vector<Edges> along_columns; // turned panels: per term
};

} // namespace palpate
