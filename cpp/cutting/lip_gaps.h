// The gaps between the lips of a cut, node by node. From Python's palpate.tissue.lip_gaps and in the exported page.
#pragma once
#include <array>
#include <cstdint>
#include <vector>

namespace palpate {

// A surface embedded in tetrahedra, as CutSkin has it.
struct EmbeddedSkin {
    int vertices, triangles;
    const int32_t* triangle; // (triangles, 3) vertices
    const uint8_t* lip;      // (triangles)
    const int32_t* carrier;  // (vertices, 4) nodes that move each,
    const double* weight;    // (vertices, 4) and how much
    const double* place;     // (vertices, 3) mm
    const int32_t* origin;   // (nodes) node of the mesh before the cut
};

// Sparse columns: gap g has the nodes node[first[g]] to node[first[g + 1] - 1], ascending.
struct LipGaps {
    std::vector<int> first, node;
    std::vector<std::array<double, 3>> normal;  // the gap is the sum of normal' u over its nodes
    std::vector<std::array<double, 6>> tangent; // the slips along two directions, three numbers each
    int count() const { return int(first.size()) - 1; }
};

// The weighted mean of the gap over each part of the cut. A node of the mesh before, of which the two lips have two
// copies, has a part: its weight is the node's own shape function, so the means are those of a mortar method. With it
// the jump of the displacement along the normal is integrated over the faces of the cut (one point a corner). Where the
// blade has turned, a node has a gap on each side of the kink. At rest all gaps are 0.
// same: mm, vertices that are nearer to each other are at one place.
LipGaps lip_gaps(const EmbeddedSkin& skin, double same);

} // namespace palpate
