// Splits tetrahedra at edges until a blade's surface is a set of their faces. Used on the caller's thread when a mesh
// is cut (bindings/cutting.cpp).
#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <vector>

namespace palpate {

using Point3 = std::array<double, 3>;

// A triangle of a blade.
struct BladeTriangle {
    Point3 corner[3], normal, outwards[3]; // mm; units; of its sides, out of it
    BladeTriangle(const double* a, const double* b, const double* c);
    double height(const double* x) const;           // mm above the plane
    double beyond(const double* x, int side) const; // mm out of the triangle over a side
    // False for tetrahedra that surely lie more than `near` mm from the triangle.
    bool meets(const double* const x[4], double near) const;
};

// The triangles of a blade: points (.., 3) mm, triangles (count, 3).
std::vector<BladeTriangle> blade_triangles(const double* points, const int32_t* triangles, int count);

// Tetrahedra into which those of a mesh are split, and the faces among them that a blade has passed. Only edges are
// split, each together with all tetrahedra around it, so that neighbours always fit. What side of a plane a point is on
// is decided once, when it is made: rounding cannot contradict itself.
class SlitComplex {
public:
    using Face = std::array<int, 3>; // its points, ascending
    struct Support {                 // the nodes of the mesh between which a point lies, and their weights
        int count = 0, node[4] = {-1, -1, -1, -1};
        double weight[4] = {};
        void add(int of, double w);
    };
    // near: mm; what lies so near to a plane lies on it.
    SlitComplex(const double* nodes, int node_count, const int32_t* tets, int tet_count, double near);
    void slit(const std::vector<BladeTriangle>& blade);
    // The number of a new point at (1 - t) a + t b: each tetrahedron of the edge ab becomes two.
    int split(int a, int b, double t);

    std::vector<double> place;              // (points, 3) mm
    std::vector<Support> support;           // of the points
    std::vector<std::array<int, 4>> corner; // points of the tetrahedra, positively oriented
    std::vector<int> parent;                // of each tetrahedron, that of the mesh
    std::map<Face, Point3> cut;             // the blade's normal at the faces that it has passed
    std::vector<uint8_t> gone;              // of each tetrahedron: it was taken away, and no blade passes it any more

private:
    const double near;
    std::vector<std::array<int, 4>> whole; // nodes of the tetrahedra of the mesh
    std::vector<std::vector<int>> pieces;  // of each tetrahedron of the mesh
    std::vector<std::vector<int>> around;  // of each point the tetrahedra, ascending
    std::vector<uint8_t> active;           // of each tetrahedron: the triangle may pass it
    std::vector<int> actives;

    bool meets(const BladeTriangle& triangle, const std::array<int, 4>& tet) const;
    // Whether all points that count as on the triangle's plane lie on it.
    bool slit(const BladeTriangle& triangle, const std::vector<int>& reached);
    template <class Distance> std::vector<int8_t> split_across(const Distance& distance, std::vector<Face> edges);
    std::vector<Face> faces_on(const std::vector<int8_t>& height, const std::vector<uint8_t>& out) const;
    std::vector<int> about(int a, int b) const;
    void halve(int k, int a, int b, int point);
};

} // namespace palpate
