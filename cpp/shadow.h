#pragma once
#include <cstdint>

namespace palpate {

// Convex solids in parts: each part is what its solids have in common and adds its attenuation where it is. A solid is
// `numbers` doubles: kind 0, ellipsoid: axes over radii (3 x 3, columns are axes) and the centre; kind 1, box: its
// lowest and its highest corner.
struct Solids {
    static constexpr int64_t numbers = 12;
    const int64_t* first;      // (parts + 1) of its solids
    const double* attenuation; // (parts) 1/mm
    const int64_t* ranges;     // (parts, 4): first and last row and column of rays, beyond which no ray meets the part
    const int64_t* kind;
    const double* solid; // (solids, numbers)
    int64_t parts;
};

// Rays from a source to a panel: `subrays` a pixel along each direction; origin: where the first ray ends; down, right:
// from there to the next row and column of rays, mm.
struct Rays {
    const double *source, *origin, *down, *right;
    int64_t rows, columns, subrays; // of pixels
};

// out: (rows, columns), mean over a pixel's rays of e^-p, p the exact line integral from the source to the panel.
void transmission(const Solids& solids, const Rays& rays, double* out);

} // namespace palpate
