#pragma once
#include "descent.h"
#include "footprint.h"
#include "lanes.h"
#include "strip.h"

namespace palpate {

// Footprints of the views whose layout is not separable, as lists of measured pixels: voxel by voxel and lane by lane.
class Lists {
public:
    struct Voxel {
        std::vector<int64_t> pixels;
        std::vector<float> weight;
    };
    // What a thread needs: the footprints of a strip's voxels at one x, (listed views, lanes), and a float a measured
    // pixel, 0 between voxels.
    struct Scratch {
        std::vector<Voxel> voxels;
        std::vector<float> sums;
    };

    explicit Lists(const Geometry& geometry);
    bool empty() const { return listed.empty(); }
    void make(int z);
    int rows_apart(size_t i, int z) const; // of the i-th listed view
    size_t size() const { return listed.size(); }

    // Adds the slope and curvature of voxel x of each row of the strip.
    void measure(const Strip& strip, int x, Paraboloid& data, Scratch& scratch, Lanes& slope, Lanes& curvature) const;
    // slope += curvature · A (change) for the voxels measured last.
    void move(const Strip& strip, const Lanes& change, Paraboloid& data, const Scratch& scratch) const;

private:
    const Geometry& geometry;
    Footprints footprints;
    std::vector<int> listed;    // views
    std::vector<int> fine_rows; // of a tilted view's fine panel that one measured pixel touches at most
    int slice = 0;

    void footprint(int view, int y, int x, std::vector<float>& sums, Voxel& out) const;
};

} // namespace palpate
