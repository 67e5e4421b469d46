#pragma once
#include <cstdint>
#include <vector>

namespace palpate {

// A matrix of 3x3 blocks by rows, both triangles, columns ascending, every diagonal block present.
struct BlockRows {
    std::vector<int> start, column;
    std::vector<double> block; // (start[nodes], 3, 3)
    int nodes() const { return int(start.size()) - 1; }
};

// Each node's value from eight parents of the next coarser level; a weight may be 0.
struct Interpolation {
    std::vector<int> parent;   // (nodes, 8), times four
    std::vector<float> weight; // (nodes, 8)
    int parents = 0;
};

// Linear elasticity on linear tetrahedra.
struct Elements {
    const double* node;     // (nodes, 3) mm
    const int32_t* tet;     // (tets, 4)
    const double *lam, *mu; // (tets) Lame's constants, N/mm^2
    const uint8_t* held;    // (nodes) 1: stands still
    int nodes, tets;
};

// An order of n things in which neighbours in the list stand a `ways`-th of it apart: a sweep then meets rows that do
// not wait for each other, and each part is still swept in its own order.
std::vector<int> interleaved(int n, int ways);

// The stiffness of the elements, N/mm; rows of held nodes too, for the forces of the support.
BlockRows stiffness(const Elements& mesh);

// The nodes of a lattice of cubic cells, and a stiffness between those that share a cell.
class Lattice {
public:
    // The coarse space of a mesh: trilinear functions on cells of `edge` mm, as the mesh's nodes see them. Cells that
    // the mesh fills too little are no cells: what lies in them is extrapolated from the nearest that is one, so that
    // every unknown has support. Stiffness: each tet with the trilinear function of the cell of its centre, which
    // couples a lattice node to 26 others only, where the Galerkin product would have 124, and reproduces linear fields
    // exactly.
    Lattice(const Elements& mesh, double edge, Interpolation& up);

    // The lattice of twice the cells' edge; the Galerkin product.
    Lattice halved(Interpolation& up) const;

    int nodes() const { return int(place.size() / 3); }
    BlockRows stiffness() const;

private:
    Lattice() = default;
    static constexpr int around = 27;
    int extent[3];                // lattice nodes along x, y, z
    std::vector<int> place;       // (nodes, 3) lattice steps
    std::vector<int> number;      // of a lattice point, or -1
    std::vector<double> coupling; // (nodes, 27, 3, 3)
    int index(int x, int y, int z) const { return (x * extent[1] + y) * extent[2] + z; }
    void number_nodes(const std::vector<uint8_t>& used);
    double* between(int a, int b);
};

} // namespace palpate
