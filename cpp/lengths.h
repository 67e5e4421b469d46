#pragma once
#include "buffer.h"
#include "geometry.h"

namespace palpate {

// The rays' lengths in a sub-slice, over some columns of the image of a panel parallel to the slices. Along a row the
// distance d of a pixel from the focal spot changes little: d = m √(1 + u), m that of the middle column,
// u = (d² - m²) / m², whose numerator is the same in all rows.
class Lengths {
    Vec3 middle, down; // mm, from the focal spot to the middle column of row 0, and from row to row
    double thickness = 0;
    double most = 0; // of |d² - m²|, mm²
    int count = 0;
    Buffer beyond; // d² - m² of each column

public:
    // Columns begin .. begin + count - 1.
    void make(const View& view, int begin, int count);
    // to[i] = from[i] * length of the ray to pixel (row, begin + i), mm. They may be the same.
    void scale(int row, const float* from, float* to) const;
};

} // namespace palpate
