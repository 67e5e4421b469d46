#pragma once
// Columns of the inverse Cholesky factor, from which GreensFunctions computes its blocks. Used by its writing thread.
#include "compliance/factored_stiffness.h"
#include "linalg/triangular_solve.h"
#include <memory>

namespace palpate {

// The columns y = L^-1 e of unit forces on a vertex, K = L L'. They are zero except on the vertex's path to the root of
// the elimination tree, and the compliance between two vertices is G_ij = y_i' y_j, over the part that their paths
// share. So a block between two vertices that have their columns needs no backward substitution, which visits more of
// the tree than the forward one.
class HalfSolves {
public:
    explicit HalfSolves(const FactoredStiffness& stiffness);

    static constexpr int batch = 8; // vertices that are solved for together: 24 columns

    void compute(const int* vertices, int count); // at most `batch`
    bool has(int vertex) const { return bool(columns[vertex]); }
    void drop(int vertex);
    // G_ij of two vertices that have their columns: displacement of i under forces on j, row by row along i. The bits
    // of (i, j) are those of (j, i).
    void block(int i, int j, float out[9]) const;
    size_t bytes() const { return stored_bytes; }

private:
    const FactoredStiffness& stiffness;
    const Supernodes& tree;
    TriangularSolve<float> substitution;
    std::vector<std::unique_ptr<float[]>> columns; // (vertices) (3, rows of its path), from the leaf to the root
    std::vector<int64_t> path_rows;                // (supernodes) rows of the path from it to the root
    std::vector<int> path, places;
    std::vector<uint8_t> mark;
    size_t stored_bytes = 0;
    int leaf(int vertex) const { return tree.part[tree.place[stiffness.vertex_free[vertex]]]; }
};

} // namespace palpate
