#pragma once
// Solves with the factored stiffness at rest, in float32. HyperelasticState owns one; used in the loop's thread.
#include "linalg/partial_solve.h"
#include "tissue/contact_patch.h"
#include <vector>

namespace palpate {

// Preconditions the descent, so single precision is enough. Vectors cover the whole mesh, (nodes, 3), and are zero on
// fixed nodes. Allocates only when it is made.
class RestStiffness {
public:
    // free_nodes: the mesh's number of each node of the factor. value: the factor, rounded.
    RestStiffness(const Supernodes& tree, const float* value, const std::vector<int>& free_nodes, int nodes);

    void solve(const double* load, double* out);       // out = K^-1 load
    void solve_three(const double* load, double* out); // the same of (3, nodes, 3), in less than twice the time of one
    // The displacements under unit forces along x, y and z, each spread over the patch by its weights: (3, nodes, 3).
    void solve_patch(const ContactPatch& patch, double* out);

private:
    const Supernodes& tree;
    const float* value;
    const std::vector<int>& free_nodes;
    const int nodes;
    std::vector<int> free_index;       // (nodes) number in the factor, or -1
    std::vector<int> supernodes, rows; // all supernodes, all nodes of the factor
    TriangularSolve<float> single;     // one right-hand side
    TriangularSolve<float> group;      // eight right-hand sides
    PartialSolve<float> partial;       // eight right-hand sides, few nonzeros
    std::vector<int> loaded;
    std::vector<float> load, solution;
};

} // namespace palpate
