// The surface of a cut body: the organ's own and the lips of the cut, embedded in its tetrahedra.
#pragma once
#include "cutting/virtual_nodes.h"

namespace palpate {

// A closed, oriented surface whose vertices move with tetrahedra. A point of the complex is one vertex for all parts
// that hang together there, so the lips of a cut have vertices of their own, but for those at the blade's tip, where
// they meet.
struct CutSkin {
    std::vector<std::array<int, 3>> triangle; // vertices, normals outwards
    std::vector<uint8_t> lip;                 // (triangles) 1 on a face that a blade has made
    std::vector<int> tet;                     // (vertices) the tetrahedron that moves each
    std::vector<double> weight;               // (vertices, 4) how much each of its corners counts
};

// nodes, tets: of the mesh before. made: its copies.
CutSkin cut_skin(const SlitParts& parts, const VirtualNodes& made, const double* nodes, const int32_t* tets);

// Edges of the complex at which the surface of its parts would meet itself; once they are split, it does not.
std::vector<std::array<int, 2>> pinched_edges(const SlitParts& parts);

// What a display draws of it. A vertex on the rim of a cut is there twice, so that the rim is sharp; those of the lips
// come last, by rank.
struct DrawnSkin {
    std::vector<int> vertex;                  // (drawn vertices) of the skin
    std::vector<std::array<int, 3>> triangle; // drawn vertices
    std::vector<int> lips;                    // (ranks) the first vertex on lips of each rank
};

// rank: (vertices) of the region that each one moves with, 0 to ranks - 1.
DrawnSkin drawn_skin(const std::vector<std::array<int, 3>>& triangle, const std::vector<uint8_t>& lip,
                     const std::vector<int>& rank, int ranks);

} // namespace palpate
