#pragma once
// The cells of smoothed tetrahedra, and the energies of their mean strain and volume. SmoothedNeoHookean calls them in
// the loop's thread. Sources: J. Bonet & A. J. Burton, Commun. Numer. Methods Eng. 14 (1998) 437; G. R. Liu & T.
// Nguyen-Thoi, Smoothed Finite Element Methods, 2010.
#include "hyperelastic/tet_block.h"
#include <vector>

namespace palpate {

// Which cell the edges and corners of each tetrahedron belong to.
struct SmoothingCells {
    const int32_t *edge, *node; // (elements, 6) and (elements, 4)
    int edges, nodes;           // cells of each kind
    const double *mu, *lambda;  // (edges), (nodes) N/mm^2
    const double* stiffening;   // (edges) b, or null
};

// The tetrahedra of the cells of one kind; each gives the same part of its volume to its per_tet cells.
struct CellTets {
    CellTets() = default;
    CellTets(const int32_t* cell, int per_tet, int elements, int count, const double* volume, const double* modulus,
             const double* stiffening = nullptr);
    std::vector<int> start, tets; // those of cell c: tets[start[c]] .. tets[start[c + 1] - 1]
    std::vector<double> volume, modulus;
    std::vector<double> stiffening; // empty if no cell stiffens
};

// Each of these works on the cells first .. first + TetBlock::lanes - 1; what lies past the last cell counts as
// nothing.

// gradients: (elements, 9), the gradient of each tetrahedron times a sixth of its volume. stress: (cells, 9) becomes
// mu (F - F^-T), F the mean, mu grown by stiffening. Returns the energy V mu [(tr F'F - 3)/2 - ln det F], or that of
// cells that stiffen; infinite where a mean is inverted or stiffer than numbers can say. `stiffened` rises to the
// largest logarithm of how much mu has grown.
double shear_energy(const CellTets& edges, int first, const double* gradients, double* stress, double& stiffened);

// stress becomes its changes where the gradients change by each of `count` changes: mu (D + G D' G), G = F^-T, and what
// stiffening adds.
// Directions follow one another: (count, elements, 9) and (count, padded cells, 9).
struct Directions {
    int count;
    size_t elements, cells; // padded
};
void shear_change(const CellTets& edges, int first, const double* gradients, const double* changes,
                  const Directions& directions, double* stress);

// volumes: (elements) a quarter of each one's volume. pressure: (cells) becomes lambda ln J / J. Returns the energy
// V lambda/2 (ln J)^2. growths: changes of the volumes, (count, elements); rise becomes the changes of the pressures.
double bulk_energy(const CellTets& nodes, int first, const double* volumes, double* pressure, const double* growths,
                   const Directions& directions, double* rise);

} // namespace palpate
