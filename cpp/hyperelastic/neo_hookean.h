#pragma once
// Energy, gradient and tangent of neo-Hookean tetrahedra. HyperelasticModel calls it in the loop's thread; immutable.
// Sources: J. Bonet & R. D. Wood, Nonlinear Continuum Mechanics for Finite Element Analysis; H. Demiray, J. Biomech. 5
// (1972) 309 (stiffening).
#include "base/aligned_buffer.h"
#include "hyperelastic/hyperelastic_energy.h"
#include "hyperelastic/tet_block.h"
#include <vector>

namespace palpate {

// Compressible neo-Hookean linear tetrahedra at finite strain, in the configuration at rest (total Lagrangian):
//
//     W = mu/2 (tr F'F - 3) - mu ln J + lambda/2 (ln J)^2,   J = det F
//
// or, of tetrahedra with a stiffening b > 0, Demiray's law, of which this is the limit for b = 0:
//
//     W = mu/2b (exp(b (tr F'F - 3 - 2 ln J)) - 1) + lambda/2 (ln J)^2
//
// At rest its tangent is the stiffness of linear elasticity. W grows without bound as an element is flattened, so a
// descent of the energy never inverts an element. All float64; elements are stored in blocks of `lanes` as structures
// of arrays, so that each loop over a block is vector code. Forces are added in the order of the elements for every
// vector width, so the sums have the same bits.
class NeoHookean : public HyperelasticEnergy {
public:
    // nodes: (count, 3) mm at rest. tets: (elements, 4), positive volumes. lambda, mu: (elements) N/mm^2. stiffening:
    // (elements) b, or null.
    NeoHookean(const double* nodes, int count, const int32_t* tets, int elements, const double* lambda,
               const double* mu, const double* stiffening = nullptr);

    Energy energy(const double* u, double* force, double* ratio, double* = nullptr) const override;
    double least_ratio(const double* u, const double* ratio) const override;
    void tangent(const double* u, const double* v, int count, double* out, double* = nullptr) const override;

    int nodes() const override { return count; }
    int padded() const override { return int(block.size()) * TetBlock::lanes; }
    size_t work_size() const override { return 0; }

    struct Block : TetBlock {
        double mu[lanes], lambda[lanes]; // times the element's volume, N mm
    };
    struct Exponents {
        double b[TetBlock::lanes];
    };

private:
    const int count;
    std::vector<Block, CacheAlignedAllocator<Block>> block;
    std::vector<Exponents, CacheAlignedAllocator<Exponents>> stiffening; // of each block; empty if no element stiffens
};

} // namespace palpate
