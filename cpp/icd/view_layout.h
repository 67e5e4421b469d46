// How coordinate descent stores the images of one view. Used by every file of icd/, on any thread.
#pragma once
#include "projection/scan_geometry.h"

namespace palpate {

constexpr int column_padding = 16; // floats beyond the last column of an image, so that whole vectors fit

// Where the rows of the image can follow the rows of the volume (and the columns x), a footprint is a sum of products
// of weights along the two, without the length of the ray's path: the image holds it. Elsewhere (oblique panels, and
// panels rotated about x) a footprint is a list of measured pixels.
struct ViewLayout {
    bool separable;
    int rows, columns;
    int64_t start, down, right; // measured pixel of (0, 0), and steps to the next row and column
    int64_t stride;             // floats from row to row

    explicit ViewLayout(const View& view);
};

} // namespace palpate
