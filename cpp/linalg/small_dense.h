// Small dense systems. Called by multigrid/, hyperelastic/ and compliance/, on the thread of the simulation.
#pragma once

namespace palpate {

// Row-major, in place.

// Gaussian elimination with row exchanges; false when a pivot is lost to rounding.
bool factor(double* A, int* pivot, int n);
void solve_factored(const double* A, const int* pivot, int n, double* x);   // x = A^-1 x
void solve_transposed(const double* A, const int* pivot, int n, double* x); // x = A'^-1 x

// Cholesky of the lower triangle; a row of which less than `part` is new is left out: its pivot is 0.
void factor_independent(double* A, int n, double part);
// x = (L L')^-1 x, every pivot positive.
void solve_positive(const double* L, int n, double* x);
// out = A^-1 of a positive definite A, n <= 16, which is overwritten; false if a row has less than 1e-6 that is new.
bool invert_positive(double* A, int n, double* out);

} // namespace palpate
