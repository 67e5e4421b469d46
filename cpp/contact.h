#pragma once
#include "model.h"
#include <cstdint>
#include <vector>

namespace palpate {

// A point of the surface: its triangle, barycentric weights there, the point itself (mm) and how far the asker was.
struct Hit {
    int triangle = -1;
    double weight[3] = {0, 0, 0};
    double point[3] = {0, 0, 0};
    double distance = 0;
};

// What a search over the surface needs to remember; one a thread, sized once.
struct SurfaceScratch {
    std::vector<uint32_t> seen; // generation in which each surface vertex was last met
    std::vector<int> queue;
    uint32_t generation = 0;
};

// The boundary of a mesh at rest. Vertices are numbered compactly; `node` gives back the mesh's own numbers.
// Immutable after it is built.
class Surface {
public:
    // nodes: (count, 3) mm; triangles: (faces, 3) node numbers, normals outwards; held: (count) nodes that cannot move.
    Surface(const double* nodes, int count, const int32_t* triangles, int faces, const uint8_t* held);

    int vertices() const { return int(node.size()); }
    int triangles() const { return int(corner.size() / 3); }
    SurfaceScratch scratch() const;

    // The surface point nearest to `point` (mm). Allocates nothing.
    Hit closest(const double point[3]) const;

    // Outward unit normal of the vertices, blended over the triangle.
    void normal(const Hit& at, double out[3]) const;

    enum class Contact { good, held, crowded };
    // The smooth patch of `radius` mm about a surface point: weights a_i (1 - d^2/radius^2)^2, held nodes 0, sum 1.
    // d is the chord, stretched where the surface turns away from the contact's normal n by 2 / (1 + n.n_i): on a plane
    // that is the plain distance, on a sphere the stereographic one, and the far side of a thin wall is infinitely far.
    // Only vertices joined to the contact by edges inside the patch count. No vertex inside: the barycentric weights.
    // held: every node of the patch is held still; crowded: more nodes than Patch::capacity. Allocates nothing.
    Contact patch(const Hit& at, double radius, SurfaceScratch& scratch, Patch& patch) const;

    std::vector<double> position;      // (vertices, 3) mm, at rest
    std::vector<double> normals;       // (vertices, 3) unit, outwards
    std::vector<double> area;          // (vertices) mm^2, a third of the triangles around
    std::vector<int> node;             // (vertices) the mesh's node
    std::vector<uint8_t> held;         // (vertices)
    std::vector<int> corner;           // (triangles, 3) vertices
    std::vector<int> start, neighbour; // vertices joined to vertex i by an edge: neighbour[start[i] .. start[i + 1]]

private:
    struct Box {
        double low[3], high[3];
        int first, count; // leaf: triangles leaf_order[first .. first + count]; else count = 0 and first = right child
    };
    std::vector<Box> tree;
    std::vector<int> leaf_order;
    int grow(int first, int count);
    void join_vertices();
};

} // namespace palpate
