#pragma once
// Node order of the smoother. MultigridModel reorders its mesh once, when it is made.
#include "multigrid/fem_stiffness.h"

namespace palpate {

// A mesh with its nodes ordered by colour: neighbours have different colours, so consecutive rows of a sweep do not
// wait for each other. Greedy colouring (Y. Saad, Iterative Methods for Sparse Linear Systems, section 3.3).
struct ColoredMesh {
    explicit ColoredMesh(const ElasticMesh& given);
    ColoredMesh(const ColoredMesh&) = delete; // `mesh` points into the arrays below
    std::vector<int> order, internal_index;   // the given number of each node, and back
    std::vector<double> node;
    std::vector<int32_t> tet;
    std::vector<uint8_t> fixed;
    ElasticMesh mesh;
};

} // namespace palpate
