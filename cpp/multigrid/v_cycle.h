#pragma once
// The multigrid preconditioner. MultigridModel applies it in each iteration, in the loop's thread; each thread needs a
// workspace of its own. Method: A. Brandt, Math. Comp. 31 (1977) 333; W. Hackbusch, Multi-Grid Methods and
// Applications.
#include "multigrid/coarse_lattice.h"
#include "multigrid/smoother.h"

namespace palpate {

// What a V-cycle writes; allocated once. Vectors of four floats per node.
struct VCycleWorkspace {
    struct Level {
        AlignedBuffer rhs, x, step, even, odd, correction; // even, odd: residuals before and after a sweep
    };
    std::vector<Level> level;
    AlignedBuffer rhs, x; // of the coarsest
};

// B, a symmetric positive definite approximation of K^-1 in float32: one V-cycle over the mesh and lattices of cells of
// doubling size. The sweeps up are the transpose of the sweeps down: B = S'(2D/omega - D) S + P B_coarse P', P with its
// smoothing, which is positive definite if B_coarse is.
class VCycle {
public:
    // K: of the mesh, with the rows of fixed nodes. edge: of the finest lattice's cells, mm. sweeps: down, and up.
    VCycle(const BlockCsr& K, const ElasticMesh& mesh, double edge, int sweeps, double relaxation);
    VCycleWorkspace make_workspace() const;
    int nodes() const { return level[0].K.nodes(); }
    std::vector<int> level_sizes() const;      // nodes of each level, finest first
    double bytes_moved(int fine_sweeps) const; // that apply() reads and writes, without caches

    // x = B rhs and product = K x, (nodes, 4). fine_sweeps: on the finest level, which costs the most.
    void apply(VCycleWorkspace& work, int fine_sweeps, const float* rhs, float* x, float* product) const;
    int sweep_count() const { return sweeps; }
    // x = P B_1 P' rhs: the coarse levels only, an eighth of the work.
    void apply_coarse(VCycleWorkspace& work, const float* rhs, float* x) const;

    const HalfBlockCsr& fine() const { return level[0].K; }

private:
    struct Level {
        HalfBlockCsr K;
        Interpolation up; // from the next coarser level
    };
    const int sweeps;
    const float relaxation;
    std::vector<Level> level;
    int coarsest_nodes = 0;
    AlignedBuffer dense; // inverse of the coarsest stiffness, (4 coarsest_nodes, row) with padded rows
    int row = 0;
    void invert_coarsest(const BlockCsr& K);
    void cycle(VCycleWorkspace& work, size_t k, int level_sweeps, const float* rhs, float* x) const; // x = B_k rhs
    void coarse_correction(VCycleWorkspace& work, size_t k, const float* r, float* out) const; // out = P B_k+1 P' r
};

} // namespace palpate
