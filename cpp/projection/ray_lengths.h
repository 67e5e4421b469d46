// Lengths of rays in a sub-slice, for a tile of the image of a parallel panel. Called by the tiles, on their threads.
#pragma once
#include "base/aligned_buffer.h"
#include "projection/scan_geometry.h"

namespace palpate {

// Along a row of the image, the distance d of a pixel from the focal spot changes little: d = m √(1 + u), with m the
// distance of the middle column and u = (d² - m²) / m², whose numerator is the same in all rows.
class RayLengths {
    int count = 0, first = 0;
    float per_height = 0;       // thickness over the height of the focal spot above the panel
    float max_difference = 0;   // of |d² - m²|, mm²
    AlignedBuffer difference;   // d² - m² of each column, mm²
    AlignedBuffer square, root; // m² and m of each row

public:
    // For columns begin .. begin + columns - 1 of rows from .. to - 1.
    void make(const View& view, int begin, int columns, int from, int to);
    // to[i] = from[i] * length of the ray to pixel (row, begin + i), mm. `to` may be `from`.
    void scale(int row, const float* from, float* to) const;
};

} // namespace palpate
