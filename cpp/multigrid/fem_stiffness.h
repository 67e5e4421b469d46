#pragma once
// The stiffness of linear elasticity on linear tetrahedra. MultigridModel and CoarseLattice assemble it once;
// MultigridModel multiplies with it in the loop's thread.
#include "linalg/block_csr.h"

namespace palpate {

struct ElasticMesh {
    const double* node;     // (nodes, 3) mm
    const int32_t* tet;     // (tets, 4)
    const double *lam, *mu; // (tets) Lame's constants, N/mm^2
    const uint8_t* fixed;   // (nodes) 1: cannot move
    int nodes, tets;
};

// Gradients of the four linear shape functions of tetrahedron t, 1/mm. Returns its volume.
double shape_gradients(const ElasticMesh& mesh, int t, double g[4][3]);

// out (3, 3) += lam g h' + mu h g' + mu (g.h) 1: the stiffness between shape functions with the gradients g and h.
void add_stiffness(double lam, double mu, const double g[3], const double h[3], double* out);

// K of the mesh, N/mm. Includes the rows of fixed nodes, which give the support's reaction forces.
BlockCsr assemble_stiffness(const ElasticMesh& mesh);

// Rows first .. last of out = K u; vectors of four numbers per node.
void multiply_rows(const BlockCsr& K, int first, int last, const double* u, double* out);

} // namespace palpate
