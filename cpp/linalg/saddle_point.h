// A small dense equilibrium under constraints. Used by relaxation/, on the thread of the simulation; no allocation.
#pragma once
#include <vector>

namespace palpate {

// A small dense equilibrium under constraints: minimise x'Lx/2 - g'x subject to W'x = d, L symmetric positive definite.
// Solved by Cholesky factors of L and of the Schur complement W'L^-1 W; the multiplier is the constraint's force.
// Arrays are sized once, so that a loop may refactor without allocating.
class SaddlePoint {
public:
    SaddlePoint(int unknowns, int constraints); // the most it will hold
    double* matrix(int unknowns);   // sets the size; rows of L to fill, lower triangle, row-major, closely packed
    double* constraints(int count); // sets the number; W to fill, (count, unknowns), one constraint a row
    void factor();                  // L, once its matrix is filled
    bool factor_constraints();      // once W is filled; false: the constraints are linearly dependent
    // g: (unknowns), becomes x. d: (constraints), becomes the multiplier.
    void solve(double* g, double* d) const;

private:
    int n = 0, m = 0;
    std::vector<double> L, W, Z, S; // Z = L^-1 W, S = W' Z
};

} // namespace palpate
