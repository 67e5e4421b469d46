#pragma once
// Neo-Hookean energy of smoothed tetrahedra. HyperelasticModel calls it in the loop's thread; immutable.
// Sources: J. Bonet & A. J. Burton, Commun. Numer. Methods Eng. 14 (1998) 437 (volume averaged over nodes); G. R. Liu &
// T. Nguyen-Thoi, Smoothed Finite Element Methods, 2010 (strain averaged over edges); H. Demiray, J. Biomech. 5 (1972)
// 309 (stiffening).
#include "base/aligned_buffer.h"
#include "hyperelastic/hyperelastic_energy.h"
#include "hyperelastic/smoothing_cells.h"

namespace palpate {

// The energy of NeoHookean with its two parts on two kinds of cells, in the configuration at rest:
//
//     E = sum_g V_g [mu_g/2 (tr F'F - 3) - mu_g ln det F]  +  sum_a V_a lambda_a/2 (ln J_a)^2  +  sum_e V_e b_e
//
// and with mu_g/2b_g (exp(b_g (tr F'F - 3 - 2 ln det F)) - 1) in the first sum for cells that stiffen.
// F is the mean gradient of a cell g, to which each tetrahedron at an edge gives a sixth of its volume; J_a is the
// volume of a cell a over that at rest, to which each tetrahedron at a node gives a quarter. At rest its tangent is the
// stiffness of smoothed elements for small strain. Averages do not keep a single tetrahedron from inverting, so
// b_e = mu_e (ln J_e/J_0)^2 below J_0 = 0.3, and 0 above.
class SmoothedNeoHookean : public HyperelasticEnergy {
public:
    static constexpr double barrier_start = 0.3; // J_0

    // nodes: (count, 3) mm at rest. tets: (elements, 4), positive volumes. mu: (elements) N/mm^2, of the barrier.
    SmoothedNeoHookean(const double* nodes, int count, const int32_t* tets, int elements, const double* mu,
                       const SmoothingCells& cells);

    Energy energy(const double* u, double* force, double* ratio, double* work) const override;
    double least_ratio(const double* u, const double* ratio) const override;
    void tangent(const double* u, const double* v, int count, double* out, double* work) const override;

    int nodes() const override { return count; }
    int padded() const override { return int(block.size()) * TetBlock::lanes; }
    size_t work_size() const override {
        return (10 + 10 * most_directions) * size_t(padded()) + 9 * most_directions * size_t(edge_lanes) +
               (1 + most_directions) * size_t(node_lanes);
    }

    struct Block : TetBlock {
        int32_t edge[6][lanes], node[4][lanes]; // cells
        double volume[lanes], mu[lanes];        // mm^3; mu times the volume, N mm
    };

private:
    const int count;
    std::vector<Block, CacheAlignedAllocator<Block>> block;
    CellTets edges, nodal;
    int edge_lanes, node_lanes; // numbers of cells, rounded up
    struct Work;
    Work divide(double* work) const;
};

} // namespace palpate
