// The stiffness of linear elasticity on tetrahedra with unknowns at their corners, assembled when a model is made; from
// Python's palpate.tissue.smoothed_elements by bindings/elements.cpp, and in the exported page. On all threads.
// Strain is averaged over edges: G. R. Liu & T. Nguyen-Thoi, Smoothed Finite Element Methods (2010); dilatation over
// nodes: J. Bonet & A. J. Burton, Commun. Numer. Methods Eng. 14 (1998) 437.
#pragma once
#include "linalg/block_csr.h"

namespace palpate {

struct ElasticSolid {
    const double* node;     // (nodes, 3) mm
    const int32_t* tet;     // (tets, 4)
    const int32_t* region;  // (tets) no average crosses from one to another
    const double *lam, *mu; // (tets) Lame's constants, N/mm^2
    int nodes, tets;
    const double* filled = nullptr; // (tets) part of each one's volume that is there; null: all of it
};

// K = sum V_g 2 mu_g e_g'e_g over the edges' cells + sum V_a lam_a d_a'd_a over the nodes' cells, N/mm, among the nodes
// whose number in `free_index` is not -1; symmetric to the bit. free_index: (nodes) ascending numbers from 0.
BlockCsr smoothed_stiffness(const ElasticSolid& solid, const std::vector<int>& free_index);

// The same where each tetrahedron is a cell of its own.
BlockCsr p1_stiffness(const ElasticSolid& solid, const std::vector<int>& free_index);

} // namespace palpate
