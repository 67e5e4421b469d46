#pragma once
// The Cholesky factors of the stiffness and the numbering of the surface. ComplianceModel makes it; read by any thread.
#include "base/vec3.h"
#include "linalg/sparse_cholesky.h"

namespace palpate {

// What Green's functions need of a tissue. Vertices are the free nodes that are touched or displayed.
struct FactoredStiffness {
    const Supernodes* tree;                    // of the factor of the stiffness among the free nodes
    const SparseCholesky* factor;              // in float64, for `displacement`; null where nothing asks for that
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

// free_index: (nodes) number among the factor's nodes, or -1. vertices: free nodes, each once. nodes: (nodes, 3) mm.
inline FactoredStiffness factored_stiffness(const Supernodes& tree, const SparseCholesky* factor,
                                            FactorValues<float> rounded, const std::vector<int>& free_index,
                                            const std::vector<int>& vertices, const double* nodes) {
    FactoredStiffness out{
        &tree, factor, std::move(rounded), free_index, std::vector<int>(free_index.size(), -1), vertices, {}, {}};
    for (int node : vertices) {
        out.vertex_index[node] = int(out.vertex_free.size());
        out.vertex_free.push_back(free_index[node]);
        out.position.insert(out.position.end(), nodes + 3 * size_t(node), nodes + 3 * size_t(node) + 3);
    }
    return out;
}

} // namespace palpate
