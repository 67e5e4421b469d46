// Exact transmission of X-rays through ellipsoids and boxes: simulated counts for tests and studies.
// Called by palpate.scans. On purpose it shares nothing with projection/, which is checked against it.
#pragma once
#include <cstdint>

namespace palpate {

// A phantom of parts. A part is the intersection of convex solids and adds its attenuation where it is. A solid is
// `numbers` doubles. Kind 0 is an ellipsoid: its axes divided by its radii (3 x 3, one axis a column), then its centre.
// Kind 1 is a box: its lowest and its highest corner.
struct Solids {
    static constexpr int64_t numbers = 12;
    const int64_t* first;      // (parts + 1): part p has the solids first[p] .. first[p + 1] - 1
    const double* attenuation; // (parts) 1/mm
    const int64_t* ranges;     // (parts, 4): first and last row and column of rays, beyond which no ray meets the part
    const int64_t* kind;
    const double* solid; // (solids, numbers)
    int64_t parts;
};

// Rays from a source to a panel, `subrays` x `subrays` for each pixel. origin: the end of the first ray; down, right:
// the vectors from there to the next row and the next column of rays, mm.
struct Rays {
    const double *source, *origin, *down, *right;
    int64_t rows, columns, subrays; // of pixels
};

// out (rows, columns): the mean over a pixel's rays of e^-p, p the exact line integral. In parallel over rows of
// pixels.
void transmission(const Solids& solids, const Rays& rays, double* out);

} // namespace palpate
