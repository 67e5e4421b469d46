#pragma once
#include "multigrid_lattice.h"
#include "multigrid_sweeps.h"

namespace palpate {

// What a V-cycle writes, sized once. Vectors of four floats a node.
struct CycleWork {
    struct Level {
        Buffer rhs, x, step, even, odd, up;
    };
    std::vector<Level> level;
    Buffer rhs, x; // of the coarsest
};

// A symmetric positive definite approximation B of K^-1 in float32: one V-cycle over the mesh and lattices of doubling
// cells (A. Brandt, Math. Comp. 31 (1977) 333), with as many sweeps of block over-relaxation on the way up, in reverse,
// as on the way down. Positive whatever the coarse levels are, so long as these are: B = S' (2D/omega - D) S + (...)'
// B_coarse (...).
class Cycle {
public:
    // K: rows of the mesh, held nodes among them. edge: of the finest lattice's cells, mm.
    Cycle(const BlockRows& K, const Elements& mesh, double edge, int sweeps, double relaxation);
    CycleWork work() const;
    int nodes() const { return level[0].K.nodes; }
    std::vector<int> sizes() const; // nodes of each level, finest first
    double moved(int some) const;   // bytes that `apply` reads and writes, each field once where it is met

    // x = B rhs and product = K x. All (nodes, 4). some: sweeps of the finest level, which cost the most.
    void apply(CycleWork& work, int some, const float* rhs, float* x, float* product) const;
    int all() const { return sweeps; }
    // x = P B_1 P' rhs, the coarse levels' answer alone, an eighth of the work.
    void apply_coarse(CycleWork& work, const float* rhs, float* x) const;

    const HalfMatrix& fine() const { return level[0].K; }

private:
    struct Level {
        HalfMatrix K;
        Interpolation up; // from the next coarser level
    };
    const int sweeps;
    const float relaxation;
    std::vector<Level> level;
    int coarsest = 0; // its nodes
    Buffer dense;     // its inverse, (3 coarsest, row) with rows of whole lanes
    int row = 0;
    void invert_coarsest(const BlockRows& K);
    void descend(CycleWork& work, size_t k, int some, const float* rhs, float* x) const; // x = B_k rhs
    void solve_coarsest(CycleWork& work) const;
};

} // namespace palpate
