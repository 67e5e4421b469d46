#pragma once
// Energy, gradient and tangent of neo-Hookean tetrahedra. HyperelasticModel calls it in the loop's thread; immutable.
// Source: J. Bonet & R. D. Wood, Nonlinear Continuum Mechanics for Finite Element Analysis.
#include "base/aligned_buffer.h"
#include <cstdint>
#include <vector>

namespace palpate {

// Compressible neo-Hookean linear tetrahedra at finite strain, in the configuration at rest (total Lagrangian):
//
//     W = mu/2 (tr F'F - 3) - mu ln J + lambda/2 (ln J)^2,   J = det F
//
// At rest its tangent is the stiffness of linear elasticity. W grows without bound as an element is flattened, so a
// descent of the energy never inverts an element. All float64; elements are stored in blocks of `lanes` as structures
// of arrays, so that each loop over a block is vector code. Forces are added in the order of the elements for every
// vector width, so the sums have the same bits.
class NeoHookean {
public:
    // nodes: (count, 3) mm at rest. tets: (elements, 4), positive volumes. lambda, mu: (elements) N/mm^2.
    NeoHookean(const double* nodes, int count, const int32_t* tets, int elements, const double* lambda,
               const double* mu);

    struct Energy {
        double value; // N mm; infinite if an element is flat or inverted
        double least; // smallest J
    };

    // Energy of the displacement u (nodes, 3) mm, and force = dE/du (nodes, 3) N, the external force that balances it;
    // ratio: (padded()) J of each element. If the energy is infinite, force and ratio are incomplete.
    Energy energy(const double* u, double* force, double* ratio) const;

    // Smallest J(u) / ratio over the elements.
    double least_ratio(const double* u, const double* ratio) const;

    // out = K(u) v, N: the derivative of the force along v (nodes, 3) mm. All J must be positive.
    void tangent(const double* u, const double* v, double* out) const;

    int nodes() const { return count; }
    int elements() const { return size; }
    int padded() const { return int(block.size()) * lanes; }

    static constexpr int lanes = 32;
    struct Block { // constants of `lanes` elements; the last block is padded with elements of zero volume
        int32_t corner[4][lanes];
        double slope[3][3][lanes]; // [corner - 1][axis] 1/mm, gradient of the corner's shape function; they sum to zero
        double mu[lanes], lambda[lanes]; // times the element's volume, N mm
    };

private:
    const int count, size;
    std::vector<Block, CacheAlignedAllocator<Block>> block;
};

} // namespace palpate
