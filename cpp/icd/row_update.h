// The update of a part of a row group along x by coordinate descent. Called by icd/coordinate_descent.cpp, on all
// threads.
#pragma once
#include "icd/column_sums.h"
#include "icd/sparse_footprints.h"
#include "statistics/mrf_prior.h"

namespace palpate {

// The voxels x = begin, begin + 1, ... of a row group as the update along x reads them: eight floats a voxel, one a
// row.
struct GroupPart {
    int begin = 0;
    AlignedBuffer f;                            // (count + 2): with the voxels before and after the part
    AlignedBuffer prior_slope, prior_curvature; // from all neighbours but the voxel updated just before in the row
    AlignedBuffer inside;                       // 0 where f = 0 is a constraint, else 1; read only if it is bounded
    std::vector<ColumnSums> columns;            // per separable view
    SparseFootprints::Scratch footprints;       // of the other views
};

// Minimises `count` voxels of a row group one after the other along x, each along its parabola; the slopes of those
// that follow take in its change at once.
struct RowUpdate {
    const Neighbourhood& neighbours;
    float beta, relaxation;
    const SparseFootprints& footprints; // of the views that are not separable
    bool bounded = false;               // a support is given

    void update(GroupPart& part, int count, bool backwards, const RowGroup& group, SurrogateImages& data) const;
};

} // namespace palpate
