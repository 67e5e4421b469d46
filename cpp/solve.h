#pragma once
#include "lists.h"

namespace palpate {

// One view as the solve along x sees it: a strip's cells, from that of column `begin` on, and the weights along x of
// SliceView::x().
struct LineView {
    const float* weight;
    const int32_t* first;
    float* cells;
    int begin, terms, width;
    int kind = terms > 2 ? 0 : 10 * terms + (width >= 2 && width <= 4 ? width : 0); // which kernel
};

// Voxels begin, begin + 1, ... of a strip, one lane a row: for every x its value and what the prior says of it across
// rows, eight floats each.
struct Line {
    int begin = 0;
    std::vector<LineView> views;
    std::vector<float> f;                   // (count + 2, lanes): with the voxels before and behind
    std::vector<float> gradient, curvature; // (count, lanes)
};

// Minimises `count` voxels of a strip one after the other along x: each along its parabola, the columns' sums of slope
// following through the cells' changes.
struct Solve {
    const Neighbourhood& neighbours;
    float beta, relaxation;
    const Lists& lists; // the views that have no cells

    void along(Line& line, int count, bool backwards, const Strip& strip, Paraboloid& data,
               Lists::Scratch& scratch) const;
};

// The data's curvature in `count` voxels, (count, lanes).
void line_curvature(const Line& line, int count, float* out);

} // namespace palpate
