// A mesh that blades have cut: used when a mesh is cut, from Python's palpate.meshes.cutting (bindings/cutting.cpp) and
// in the exported page.
#pragma once
#include "cutting/cut_skin.h"

namespace palpate {

// The mesh of a cut body, its loose pieces included.
struct CutBody {
    VirtualNodes mesh;
    CutSkin skin;
    std::vector<uint8_t> gone;    // (tets) 1 in a piece that came free by one of the cuts, which was taken away then
    std::vector<int> cut_parent;  // (faces that were cut) tetrahedron of the mesh before on one side of each,
    std::vector<double> cut_area; // and mm^2; no cut goes through what is gone
};

// nodes: (node_count, 3) mm; tets: (tet_count, 4), positively oriented; held: (node_count), or null: nothing is taken
// away. A piece is free of which no three nodes are held that are not on one line.
CutBody cut_body(const double* nodes, int node_count, const int32_t* tets, int tet_count, const uint8_t* held,
                 const std::vector<std::vector<BladeTriangle>>& cuts);

// Without what is gone.
void take_away(CutBody& body);

// The longest side of the nodes' box, mm.
double mesh_extent(const double* nodes, int count);

} // namespace palpate
