#pragma once
#include "buffer.h"
#include <cstdint>
#include <vector>

namespace palpate {

// Compressible neo-Hookean linear tetrahedra at finite strain, in the configuration at rest (total Lagrangian):
//
//     W = mu/2 (tr F'F - 3) - mu ln J + lambda/2 (ln J)^2,   J = det F
//
// (J. Bonet & R. D. Wood, Nonlinear Continuum Mechanics for Finite Element Analysis). At rest its tangent is linear
// elasticity's stiffness; as an element is flattened W grows beyond all bounds, so that what lowers the energy never
// turns an element inside out. All float64, elements in blocks of `lanes` in structure-of-arrays order, so that each
// step over a block is vector code; forces are added up in the order of the elements, whatever the vectors' width.
class NeoHookean {
public:
    // nodes: (count, 3) mm at rest. tets: (elements, 4), positive volumes. lambda, mu: (elements) N/mm^2.
    NeoHookean(const double* nodes, int count, const int32_t* tets, int elements, const double* lambda,
               const double* mu);

    struct Energy {
        double value; // N mm; infinite when an element is flat or turned
        double least; // J of the most flattened element
    };

    // Energy of displacement u (nodes, 3) mm, and force = dE/du (nodes, 3) N, what each node needs from outside to stay
    // where it is; ratio: (padded()) J of each element. When the energy is infinite force and ratio are not whole.
    Energy energy(const double* u, double* force, double* ratio) const;

    // Least over the elements of J(u) / ratio.
    double least_ratio(const double* u, const double* ratio) const;

    // out = K(u) v, N: the change of the force along v (nodes, 3) mm. All J must be positive.
    void tangent(const double* u, const double* v, double* out) const;

    int nodes() const { return count; }
    int elements() const { return size; }
    int padded() const { return int(block.size()) * lanes; }

    static constexpr int lanes = 32;
    struct Block { // constants of `lanes` elements; the last block is filled up with elements of no volume
        int32_t corner[4][lanes];
        double slope[3][3][lanes]; // [corner - 1][axis] 1/mm, gradient of the corner's shape function; they sum to zero
        double mu[lanes], lambda[lanes]; // times the element's volume, N mm
    };

private:
    const int count, size;
    std::vector<Block, CacheAligned<Block>> block;
};

} // namespace palpate
