#pragma once
// Monte Carlo images of a body: what a flat panel that integrates energy receives.
#include "scatter/antiscatter_grid.h"
#include "scatter/photon.h"

namespace palpate {

// X-rays from a point, spread evenly over a rectangle of the plane z = 0, in which the panel lies.
struct Beam {
    double source[3], low[2], high[2]; // mm
    const double *keV, *cumulative;    // (energies of the spectrum): its lines and the sum of photons up to each, to 1
    int64_t energies;
};

struct FlatPanel {
    double corner[2], pitch[2]; // low x, y; column and row pitch, mm
    int64_t rows, columns;
    const double* thickness; // (energies of Materials): attenuation times thickness of what detects; null: detects all
};

// keV, each an integer number of `unit`, so that sums are exact in any order.
struct Budget {
    int64_t emitted, deposited, escaped; // escaped: left the body, whether it meets the panel or not
    static constexpr double unit = 1.0 / (1 << 20);
};

// out (4, rows, columns): energy by Photon::order, in Budget::unit. The septa stand along y and point at the source.
Budget scatter_image(const Materials& materials, const Body& body, const Beam& beam, const FlatPanel& panel,
                     const AntiscatterGrid& grid, int64_t photons, uint64_t seed, int64_t* out);

// A pencil beam of one energy through a slab of material 0 from z = 0 to `thickness`, without end sideways; it comes
// down at an angle of that tangent to the normal, towards -x.
struct Pencil {
    double thickness, tangent, keV;
};

// Panels `gap` below the slab, each behind each of the grids, whose septa stand along y and in line with the pencil. A
// ring lies around the place where the pencil meets the panel; radius: (radii + 1), rising, mm.
struct PencilPanels {
    const double *gap, *radius;
    int64_t gaps, radii;
    const AntiscatterGrid* grid;
    int64_t grids;
};

// out (gaps, grids, radii + 1), in Budget::unit: energy scattered to each ring; last, the sum over all rings of energy
// times its distance along x, mm.
void pencil_kernels(const Materials& materials, const Pencil& pencil, const PencilPanels& panels, int64_t photons,
                    uint64_t seed, int64_t* out);

} // namespace palpate
