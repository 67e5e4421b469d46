#pragma once
#include "lists.h"
#include "strip.h"

namespace palpate {

// Voxels begin, begin + 1, ... of a strip, one lane a row, eight floats for every voxel: its value, what data and prior
// say of it, and how it is tied to the voxels behind.
struct Line {
    int begin = 0, reach = 0, margin = 0; // margin: see Bands
    Buffer f;                             // (count + 2): with the voxels before and behind
    Buffer slope, change;                 // change: (reach + count + reach), 0 outside
    std::vector<Buffer> coupling;         // 0: curvature; k: with the voxel k behind, (reach + count), the first unused
    Buffer prior_slope, prior_curvature;  // of all neighbours but the voxel just visited in the row
    std::vector<Walk*> walks;             // the views in which voxels are walked, which add to slope and curvature
};

// Minimises `count` voxels of a strip one after the other along x: each along its parabola, the others' slopes
// following.
struct Solve {
    const Neighbourhood& neighbours;
    float beta, relaxation;
    const Lists& lists; // the views that are not separable

    void along(Line& line, int count, bool backwards, const Strip& strip, Paraboloid& data,
               Lists::Scratch& scratch) const;
};

} // namespace palpate
