#pragma once
#include "lists.h"

namespace palpate {

// One view as the solve along x sees it: a strip's cells (column 0 first) and the weights along x of SliceView::x().
struct LineView {
    const float* weight;
    const int32_t* first;
    float* cells;
    int terms, width;
};

// A strip's voxels, one lane a row: for every x its value and what the prior says of it across rows, eight floats each.
struct Line {
    std::vector<LineView> views;
    std::vector<float> f;                   // (nx + 2, lanes): value x in place x + 1
    std::vector<float> gradient, curvature; // (nx, lanes)
};

// The voxels of one strip at a time are minimised along x, from `begin` in steps of `step` (1 or -1), `count` of them:
// each along its parabola, the columns' sums of slope following through the cells' changes.
struct Solve {
    const Neighbourhood& neighbours;
    float beta, relaxation;
    const Lists& lists; // the views that have no cells

    void along(Line& line, int begin, int count, int step, const Strip& strip, Paraboloid& data,
               Lists::Scratch& scratch) const;
};

// The data's curvature in voxels begin .. begin + count - 1, (count, lanes).
void line_curvature(const Line& line, int begin, int count, float* out);

} // namespace palpate
