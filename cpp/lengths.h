#pragma once
#include "buffer.h"
#include "geometry.h"

namespace palpate {

// The rays' lengths in a sub-slice, over some columns of the image of a panel parallel to the slices. Along a row the
// distance d of a pixel from the focal spot changes little: d = m √(1 + u), m that of the middle column,
// u = (d² - m²) / m², whose numerator is the same in all rows.
class Lengths {
    int count = 0, first = 0;
    float per_height = 0; // thickness over the distance of panel and focal spot
    float most = 0;       // of |d² - m²|, mm²
    Buffer beyond;        // d² - m² of each column
    Buffer square, root;  // m² and m of each row

public:
    // Columns begin .. begin + columns - 1 of rows from .. to - 1.
    void make(const View& view, int begin, int columns, int from, int to);
    // to[i] = from[i] * length of the ray to pixel (row, begin + i), mm. They may be the same.
    void scale(int row, const float* from, float* to) const;
};

} // namespace palpate
