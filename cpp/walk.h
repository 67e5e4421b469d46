#pragma once
#include "bands.h"
#include "lanes.h"
#include <vector>

namespace palpate {

// The columns under part of a strip in one view whose voxels are gone through one by one: where each shares its columns
// with many ahead of it, to know how it is coupled to every one of them would take more than to walk over the columns.
// A lane is a row of the strip.
//
// Of a voxel with weights w[tap][term] along x the columns say: curvature Σ over taps of w' C w, and slope Σ of
// w' (S + C P), with the sums S of slope and C of curvature (one a term, one a pair of terms) as they were when the
// part began, and P what the voxels passed since have changed, Σ of w · change.
struct Walk {
    const Bands* bands = nullptr;
    int terms = 0, from = 0; // first column
    Buffer sums, change;     // (columns; terms, then pairs of terms; lanes), (columns, terms, lanes)

    // The voxel measured last: its weights (taps, terms), and the changes of the first column under it.
    const float* weight = nullptr;
    float* under = nullptr;
    int taps = 0;

    // For columns from + 0 .. n - 1, nothing changed yet; the sums are still to be filled in.
    void start(const Bands& chosen, int from, int n);
};

// Adds the slope and curvature of voxel x in all of them.
void measure(const std::vector<Walk*>& walks, int x, Lanes& slope, Lanes& curvature);
// The voxel measured last has changed.
void move(const std::vector<Walk*>& walks, const Lanes& change);

} // namespace palpate
