// Footprints as lists of measured pixels, for the views whose layout is not separable. Made for each slice by
// icd/coordinate_descent.cpp; row groups are read and changed voxel by voxel and lane by lane, on all threads.
#pragma once
#include "base/simd.h"
#include "icd/row_group.h"
#include "icd/surrogate_images.h"
#include "projection/voxel_footprint.h"

namespace palpate {

class SparseFootprints {
public:
    struct Voxel {
        std::vector<int64_t> pixels;
        std::vector<float> weight;
    };
    // What a thread needs: the footprints of a group's voxels at one x, (listed views, lanes), and a float a measured
    // pixel, 0 between voxels.
    struct Scratch {
        std::vector<Voxel> voxels;
        std::vector<float> sums;
    };

    explicit SparseFootprints(const ScanGeometry& geometry);
    bool empty() const { return listed.empty(); }
    void make(int z);
    int independent_step(size_t i, int z) const; // of the i-th listed view
    size_t size() const { return listed.size(); }

    // Adds the slope and curvature of voxel x of each row of the group.
    void add_derivatives(const RowGroup& group, int x, SurrogateImages& data, Scratch& scratch, f32x8& slope,
                         f32x8& curvature) const;
    // slope += curvature · A (change) for the voxels whose derivatives were added last.
    void apply_change(const RowGroup& group, const f32x8& change, SurrogateImages& data, const Scratch& scratch) const;

private:
    const ScanGeometry& geometry;
    VoxelFootprint footprints;
    std::vector<int> listed;    // views
    std::vector<int> fine_rows; // of a tilted view's fine panel that one measured pixel touches at most
    int slice = 0;

    void footprint(int view, int y, int x, std::vector<float>& sums, Voxel& out) const;
};

} // namespace palpate
