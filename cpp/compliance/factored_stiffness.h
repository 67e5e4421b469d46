#pragma once
// The Cholesky factors of the stiffness and the numbering of the surface. ComplianceModel makes it; read by any thread.
#include "base/vec3.h"
#include "linalg/sparse_cholesky.h"

namespace palpate {

// What Green's functions need of a tissue. Vertices are the free nodes that are touched or displayed.
struct FactoredStiffness {
    const SparseCholesky* factor;              // of the stiffness among the free nodes
    FactorValues<float> rounded;               // the same in float32: columns differ by a relative 1e-5 or less
    std::vector<int> free_index;               // (nodes) number among the free nodes, or -1 for a fixed node
    std::vector<int> vertex_index;             // (nodes) number among the vertices, or -1
    std::vector<int> vertex_node, vertex_free; // (vertices) number in the mesh, and among the free nodes
    std::vector<double> position;              // (vertices, 3) mm, at rest
    int vertices() const { return int(vertex_node.size()); }
    int nodes() const { return int(free_index.size()); }
    double distance(int a, int b) const { // mm
        return palpate::distance(&position[3 * size_t(a)], &position[3 * size_t(b)]);
    }
};

} // namespace palpate
