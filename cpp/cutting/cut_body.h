// A mesh that blades have cut: used when a mesh is cut, from Python's palpate.meshes.cutting (bindings/cutting.cpp) and
// in the exported page.
#pragma once
#include "cutting/cut_skin.h"

namespace palpate {

struct CutBody {
    VirtualNodes mesh;
    CutSkin skin;
};

// nodes: (node_count, 3) mm; tets: (tet_count, 4), positively oriented; blade: (..) triangles, one after the other.
CutBody cut_body(const double* nodes, int node_count, const int32_t* tets, int tet_count,
                 const std::vector<BladeTriangle>& blade);

// Without the pieces of these numbers: gone (bodies) is 1 for each of them.
void take_away(CutBody& body, const std::vector<uint8_t>& gone);

// The longest side of the nodes' box, mm.
double mesh_extent(const double* nodes, int count);

} // namespace palpate
