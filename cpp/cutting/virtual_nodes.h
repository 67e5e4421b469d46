// Copies of the tetrahedra that a blade has passed, one for each part into which it has cut them. Each fragment is a
// copy of its tetrahedron. Copies of neighbours share the nodes of their common face where material goes through it, so
// that nodes are split by side behind the blade, and whole at its tip: N. Molino, Z. Bao & R. Fedkiw, ACM Trans. Graph.
// 23 (2004) 385; E. Sifakis, K. Der & R. Fedkiw, SCA 2007, 73.
#pragma once
#include "cutting/slit_parts.h"

namespace palpate {

struct VirtualNodes {
    std::vector<std::array<int, 4>> tet; // nodes of each copy
    std::vector<int> origin;   // (nodes) node of the mesh. The first ones are the mesh's own: of its copies one
                               // whose place is in its piece, and of these that with the most volume
    std::vector<uint8_t> real; // (nodes) 1 if its place is in its piece, and not beyond the blade
    std::vector<int> parent;   // (tets) tetrahedron of the mesh
    std::vector<double> share; // (tets) of its volume, those of all its copies sum to 1
    std::vector<int8_t> side;  // (tets) 1 where the normals of most of its cut faces point, -1 beyond, or 0
    std::vector<int> body;     // (tets) number of the piece that it belongs to
    std::vector<int> element;  // (fragments) copy that carries each
};

// tets: of the mesh before, (.., 4), positively oriented.
VirtualNodes virtual_nodes(const SlitParts& parts, const int32_t* tets);

} // namespace palpate
