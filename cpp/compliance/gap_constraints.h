#pragma once
// Surfaces of one body that may meet: the lips of a cut, organs side by side. ComplianceModel makes the constraints;
// each of its states has a GapSolver, used in the loop's thread.
#include "base/aligned_buffer.h"
#include <cstdint>
#include <vector>

namespace palpate {

// Signorini's conditions, linear and without friction: each gap = rest + N'u >= 0, each force p between the surfaces
// >= 0, and one of the two is 0. A gap is a weighted mean over a part of the surface. Let D be the displacement of the
// tools' patches under unit forces p, S the stiffness of their contacts, d their displacements. The tools' forces on
// the tissue are f = S (d - D p), and gap = rest + D'f + W p with W = N'K^-1 N: a linear complementarity problem in p,
// whose matrix W - D'S D is positive semidefinite. A spring across a gap obeys p = -N'u / give instead, of any sign.
struct GapConstraints {
    static constexpr int most = 1024;
    int count = 0;
    int stride = 0;               // of rows: `count` rounded up to a cache line
    std::vector<double> rest;     // (count) mm
    std::vector<double> give;     // (count) mm/N of a spring; 0: surfaces that may meet
    AlignedBuffer between;        // (count, stride) mm/N: W
    AlignedBuffer response;       // (vertices, 3, stride) mm/N: K^-1 N
    std::vector<int> first, node; // constraint i: free nodes node[first[i]] to node[first[i + 1] - 1]
    std::vector<double> share;    // (entries of `node`, 3): N

    // Adds the displacement of all vertices, (vertices, 3) mm, under forces p (stride) N.
    void add_displacement(const float* p, float* out) const;
    void add_load(const double* p, double* load) const; // N p on the free nodes, (free nodes, 3) N
};

class GapSolver {
public:
    explicit GapSolver(const GapConstraints& gaps, int patches);
    // D of a patch: weight (count) of these vertices.
    void set_patch(int patch, const int* vertices, const double* weight, int count);
    // Moves p towards the solution by sweeps of projected Gauss-Seidel. stiffness: S (n, n) N/mm of the first n / 3
    // patches, displacement: d (n) mm.
    void solve(const double* stiffness, const double* displacement, int n, int sweeps, double* p);
    void patch_displacement(int patch, const double* p, double out[3]) const; // D p

private:
    const GapConstraints& gaps;
    AlignedBuffer moved;  // (3 patches, stride) mm/N: D
    AlignedBuffer stiff;  // (3 patches, stride): S D
    AlignedBuffer matrix; // (count, stride) mm/N: rows of W - D'S D, those that are `known`
    AlignedBuffer gap;    // (stride) mm
    std::vector<uint8_t> known;
    const float* row(int i, int n);
};

} // namespace palpate
