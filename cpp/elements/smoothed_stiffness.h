// The stiffness of linear elasticity on smoothed tetrahedra, assembled once when a model is made: by the exported page,
// which has no SciPy. Python's palpate.tissue.smoothed_elements holds the same sums, and the tests compare the two.
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
};

// K = sum V_g 2 mu_g e_g'e_g over the edges' cells + sum V_a lam_a d_a'd_a over the nodes' cells, N/mm, among the nodes
// whose number in `free_index` is not -1. free_index: (nodes) ascending numbers from 0.
BlockCsr smoothed_stiffness(const ElasticSolid& solid, const std::vector<int>& free_index);

} // namespace palpate
