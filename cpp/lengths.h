#pragma once
#include "buffer.h"
#include "geometry.h"

namespace palpate {

// The rays' lengths in a sub-slice, over some columns of the image of a panel parallel to the slices. Along a row the
// distance d of a pixel from the focal spot changes little: d = m √(1 + u), m that of the middle column,
// u = (d² - m²) / m², whose numerator is the same in all rows.
class Lengths {
    const View* view = nullptr;
    int begin = 0, count = 0, middle = 0;
    double most = 0; // of |d² - m²|, mm²
    Buffer beyond;   // d² - m² of each column
    void vector(int row, int column, double* out) const;

public:
    // Columns begin .. begin + count - 1.
    void make(const View& view, int begin, int count);
    // to[i] = from[i] * length of the ray to pixel (row, begin + i), mm. They may be the same.
    void scale(int row, const float* from, float* to) const;
};

} // namespace palpate
