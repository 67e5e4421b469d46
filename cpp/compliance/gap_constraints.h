#pragma once
// Surfaces of one body that may meet: the lips of a cut, organs side by side. ComplianceModel makes the constraints;
// each of its states has a GapSolver, used in the loop's thread.
#include "base/aligned_buffer.h"
#include <cstdint>
#include <vector>

namespace palpate {

// Signorini's conditions, linear: each gap = rest + N'u >= 0, each force p between the surfaces >= 0, and one of the
// two is 0. A gap is a weighted mean over a part of the surface. Let D be the displacement of the tools' patches under
// unit forces p, S the stiffness of their contacts, d their displacements. The tools' forces on the tissue are f = S (d
// - D p), and gap = rest + D'f + W p with W = N'K^-1 N: a linear complementarity problem in p, whose matrix W - D'S D
// is positive semidefinite. A spring across a gap obeys p = -N'u / give instead, of any sign. With friction each gap
// has two more rows, the slip of the surfaces along each other and the force q against it. Coulomb's law: |q| <=
// friction p, and they slip against q where |q| is that much. From tick to tick, slip is counted from where the
// surfaces stuck last.
struct GapConstraints {
    static constexpr int most = 1024, most_rows = 3 * most;
    int count = 0;
    double friction = 0;          // Coulomb's coefficient
    int rows = 0;                 // the gaps, then with friction two of slip for each
    int stride = 0;               // `rows` rounded up to a cache line
    std::vector<double> rest;     // (count) mm
    std::vector<double> give;     // (count) mm/N of a spring; 0: surfaces that may meet
    AlignedBuffer between;        // (rows, stride) mm/N: W
    AlignedBuffer response;       // (vertices, 3, stride) mm/N: K^-1 N
    std::vector<int> first, node; // row i: free nodes node[first[i]] to node[first[i + 1] - 1]
    std::vector<double> share;    // (entries of `node`, 3): N

    bool rubs() const { return rows > count; }
    // Of a state: forces p and q (rows) N, then with friction where each gap's surfaces stuck, (count, 2) mm of slip.
    int numbers() const { return rubs() ? rows + 2 * count : rows; }
    // Adds the displacement of all vertices, (vertices, 3) mm, under forces (stride) N.
    void add_displacement(const float* p, float* out) const;
    void add_load(const double* p, double* load) const; // N p on the free nodes, (free nodes, 3) N
    double energy(const double* p) const;               // N mm, what these forces add to the tissue's
};

class GapSolver {
public:
    explicit GapSolver(const GapConstraints& gaps, int patches);
    // D of a patch: weight (count) of these vertices.
    void set_patch(int patch, const int* vertices, const double* weight, int count);
    // Moves the forces towards the solution by sweeps of projected Gauss-Seidel. stiffness: S (n, n) N/mm of the first
    // n / 3 patches, displacement: d (n) mm. p: (numbers()). Returns what has rubbed away, N mm.
    double solve(const double* stiffness, const double* displacement, int n, int sweeps, double* p);
    void patch_displacement(int patch, const double* p, double out[3]) const; // D p

private:
    const GapConstraints& gaps;
    AlignedBuffer moved;  // (3 patches, stride) mm/N: D
    AlignedBuffer stiff;  // (3 patches, stride): S D
    AlignedBuffer matrix; // (rows, stride) mm/N: rows of W - D'S D, those that are `known`
    AlignedBuffer gap;    // (stride) mm: gaps, then slips
    std::vector<uint8_t> known;
    const float* row(int i, int n);
    bool press(int i, int n, double* p);
    bool rub(int i, int n, double* p);
    double stick(double* p) const;
};

} // namespace palpate
