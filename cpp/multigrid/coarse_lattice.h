#pragma once
// One coarse level of the multigrid hierarchy: a lattice of cubic cells. VCycle makes them, from fine to coarse.
#include "multigrid/fem_stiffness.h"

namespace palpate {

// The value of each node from eight parents of the next coarser level; a weight may be 0.
struct Interpolation {
    std::vector<int> parent;   // (nodes, 8), times four: offset in a vector of four floats per node
    std::vector<float> weight; // (nodes, 8)
};

// The nodes of the lattice, and a stiffness between nodes that share a cell.
class CoarseLattice {
public:
    // The coarse space of a mesh: trilinear functions on cells of `edge` mm, evaluated at the mesh's nodes. Cells that
    // the mesh fills too little are not active: nodes in them extrapolate from the nearest active cell, so that every
    // unknown has support. Stiffness: each tetrahedron takes the trilinear function of the cell of its centre. That
    // couples a lattice node to 26 others, where the Galerkin product would couple 124, and is exact for linear fields.
    CoarseLattice(const ElasticMesh& mesh, double edge, Interpolation& up);

    // The lattice of cells with twice the edge; its stiffness is the Galerkin product.
    CoarseLattice coarsen(Interpolation& up) const;

    int nodes() const { return int(index3.size() / 3); }
    BlockCsr stiffness() const;

private:
    CoarseLattice() = default;
    static constexpr int neighbourhood = 27;
    int extent[3];                // lattice nodes along x, y, z
    std::vector<int> index3;      // (nodes, 3) lattice coordinates
    std::vector<int> number;      // (lattice points) number of the node, or -1
    std::vector<double> coupling; // (nodes, 27, 3, 3)
    int index(int x, int y, int z) const { return (x * extent[1] + y) * extent[2] + z; }
    void number_nodes(const std::vector<uint8_t>& used);
    double* block(int a, int b); // of coupling, between two nodes
};

} // namespace palpate
