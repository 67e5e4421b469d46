// How the parts of a slit complex hang together; virtual_nodes.h and cut_skin.h start from it.
#pragma once
#include "cutting/slit_complex.h"

namespace palpate {

// The corners of the faces of a tetrahedron with positive volume, outwards.
constexpr int tet_face[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};

struct SlitParts {
    explicit SlitParts(const SlitComplex& slit);

    const SlitComplex& slit;
    std::vector<double> volume;   // (parts) mm^3
    std::vector<int> beyond;      // (parts, 4) the part on the other side of each face of `tet_face`, or -1
    std::vector<uint8_t> passed;  // (parts, 4) 1: a blade has passed this face
    std::vector<int8_t> above;    // (parts, 4) of such a face: 1 if the blade's normal points to this part, else -1
    std::vector<int> fragment;    // (parts) parts of one tetrahedron that hang together within it have one number
    std::vector<int> body;        // (parts) whatever hangs together has one number
    std::vector<int> owner;       // (fragments) tetrahedron of the mesh
    std::vector<double> share;    // (fragments) part of its volume
    std::vector<int> fragment_of; // (fragments) the first part of each

    int count() const { return int(volume.size()); }
    bool bonded(int face) const { return beyond[face] >= 0 && !passed[face]; }
    double area(int face) const; // mm^2
    // (parts, 4) vertices of a surface: corners of bonded parts that lie at one point have one number.
    std::vector<int> vertices() const;
    // Calls give(a, b), the places of equal points among the corners of two bonded parts i and j: 4 i + .., 4 j + ..
    template <class Give>
    static void common_corners(const std::array<int, 4>& a, const std::array<int, 4>& b, int i, int j,
                               const Give& give) {
        for (int m = 0; m < 4; m++)
            for (int n = 0; n < 4; n++)
                if (a[m] == b[n]) give(4 * i + m, 4 * j + n);
    }

private:
    void pair_faces();
    void mark_passed();
    void group();
    bool stick_crumbs();
};

// What is smaller, of a tetrahedron's volume, belongs to another part of the same tetrahedron.
constexpr double least_share = 1e-6;

} // namespace palpate
