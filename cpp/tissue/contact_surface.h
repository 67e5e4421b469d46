#pragma once
// The surface of a mesh at rest: closest points (contact_surface.cpp) and contact patches (contact_weights.cpp). Made
// once per mesh; the loop's thread queries it.
#include "tissue/box_tree.h"
#include "tissue/contact_patch.h"
#include <cstdint>
#include <vector>

namespace palpate {

// A point of the surface: its triangle, its barycentric weights, its position (mm) and its distance from the query
// (mm).
struct SurfacePoint {
    int triangle = -1;
    double weight[3] = {0, 0, 0};
    double point[3] = {0, 0, 0};
    double distance = 0;
};

// A patch of any number of nodes.
struct WidePatch {
    explicit WidePatch(int capacity) : capacity(capacity), node(capacity), weight(capacity) {}
    int capacity;
    int count = 0;
    std::vector<int> node;
    std::vector<double> weight;
};

// Working memory of patch(); one per thread, allocated once.
struct SurfaceScratch {
    std::vector<uint32_t> visited, visited_triangle; // the generation that last visited each vertex and triangle
    std::vector<int> queue;                          // vertices or triangles, in the order in which they were found
    std::vector<int> entry;                          // (vertices) its place in the patch, or -1 for a fixed one
    WidePatch wide{0};                               // of a carried surface: the patch of its vertices,
    std::vector<uint32_t> visited_node;              // and (nodes) which nodes have an entry
    std::vector<int> node_entry;
    int found = 0; // triangles in `queue` after patch()
    uint32_t generation = 0;
};

// The boundary of a mesh at rest. Its vertices are numbered from 0; `node` holds their numbers in the mesh. Does not
// change after construction and carry(), so any number of threads may query it. Closest points: C. Ericson, Real-Time
// Collision Detection (2005), section 5.1.5, over a tree of axis-aligned boxes.
class ContactSurface {
public:
    // nodes: (count, 3) mm; triangles: (faces, 3) node numbers, outward normals; fixed: (count) 1 for a node that
    // cannot move.
    ContactSurface(const double* nodes, int count, const int32_t* triangles, int faces, const uint8_t* fixed);

    // The surface of a cut body: its vertices lie inside elements. carrier: (count, 4) nodes of the mesh that move each
    // of the constructor's nodes, and share: (count, 4) how much; held: (nodes) 1 for a node that cannot move.
    void carry(const int32_t* carrier, const double* share, int count, const uint8_t* held, int nodes);
    bool carried() const { return !carrier.empty(); }

    int vertices() const { return int(node.size()); }
    int triangles() const { return int(corner.size() / 3); }
    SurfaceScratch scratch() const;

    // The surface point closest to `point` (mm). Allocates nothing.
    SurfacePoint closest(const double point[3]) const;

    // Outward unit normal: the vertex normals, interpolated over the triangle.
    void normal(const SurfacePoint& at, double out[3]) const;

    enum class PatchStatus { good, all_fixed, too_many_nodes };
    // The smooth patch of `radius` mm around a surface point, phi = (1 - d^2/radius^2)^2 inside the radius and 0
    // outside: the weight of node a is the integral of N_a phi over the surface, divided by that of phi, so that the
    // weighted mean of nodal values is the mean of the field weighted by phi. Fixed nodes have weight 0, and the others
    // share the sum of 1. d^2 is the squared distance times 2 / (1 + n.n_q), n the contact's normal and n_q the normal
    // at the point: on a plane the distance itself, on a sphere the stereographic one, and infinite on the far side of
    // a thin wall. Only triangles that hang together with the contact inside the patch count. If no vertex is inside,
    // the patch is the contact's triangle with the barycentric weights. all_fixed: no node inside can move.
    // too_many_nodes: more than ContactPatch::capacity. Of a carried surface the vertices' weights are handed to the
    // nodes that move them. Allocates nothing.
    PatchStatus patch(const SurfacePoint& at, double radius, SurfaceScratch& scratch, ContactPatch& patch) const;

    // The weights of the surface's own vertices, carried or not, with room for all.
    PatchStatus patch(const SurfacePoint& at, double radius, SurfaceScratch& scratch, WidePatch& patch) const;

    // The same patch with the weights of version 0.1, area_a phi(x_a), which are no integrals and change with the place
    // on the mesh. Only replays of its records use them.
    PatchStatus nodal_patch(const SurfacePoint& at, double radius, SurfaceScratch& scratch, ContactPatch& patch) const;

    std::vector<double> position;      // (vertices, 3) mm, at rest
    std::vector<double> normals;       // (vertices, 3) outward unit normals; 0 where the lips of a cut end
    std::vector<double> area;          // (vertices) mm^2, a third of the adjacent triangles
    std::vector<int> node;             // (vertices) number in the mesh
    std::vector<uint8_t> fixed;        // (vertices) 1: cannot move
    std::vector<int> corner;           // (triangles, 3) vertices
    std::vector<int> start, neighbour; // edge neighbours of vertex i: neighbour[start[i] .. start[i + 1]]
    std::vector<int> across; // (triangles, 3) the triangle beyond the edge from corner c to the next; itself if none

    BoxTree tree;                      // over the triangles
    std::vector<int> carrier;          // (count, 4) as given to carry(), or empty
    std::vector<double> carrier_share; // (count, 4)
    std::vector<uint8_t> held_node;    // (nodes)

private:
    void build_tree();
    void build_adjacency();
    void link_triangles();
    template <class Patch>
    PatchStatus integral_patch(const SurfacePoint& at, double radius, SurfaceScratch& scratch, Patch& patch) const;
    template <class Patch> PatchStatus barycentric_patch(const SurfacePoint& at, Patch& patch) const;
    PatchStatus hand_to_nodes(SurfaceScratch& scratch, ContactPatch& patch) const;
};

} // namespace palpate
