#pragma once
// Block Gauss-Seidel with over-relaxation (SOR) on half of a symmetric matrix. VCycle calls it in the loop's thread.
// Method: G. H. Golub & C. F. Van Loan, Matrix Computations, section 11.2.
#include "linalg/block_csr.h"

namespace palpate {

// K = L + D + L'. A sweep meets each row of L once: it gathers (L v) and scatters the row's transpose (L' v), so one
// pass over half of the matrix relaxes and updates the residual. Vectors have four floats per node, the fourth zero.

// Forward sweep from zero: solves (D/omega + L) d = r. next becomes r - K d; x becomes d (first) or x + d.
void sor_forward(const HalfBlockCsr& K, float omega, const float* r, float* d, float* next, float* x, bool first);

// First backward sweep, after a coarse correction e: solves (D/omega + L') d = r - K e; x += e + d. r becomes the new
// residual plus L d; the next sweep, or product_from_residual(), subtracts L d when it reads L. scatter: zero on entry.
void sor_backward_first(const HalfBlockCsr& K, float omega, const float* e, float* r, float* d, float* scatter,
                        float* x);

// Further backward sweeps, with d, r and x as the one before left them. scatter: zero on entry.
void sor_backward(const HalfBlockCsr& K, float omega, float* r, float* d, float* scatter, float* x);

// After the last backward sweep: out = rhs - (r - L d), which is K x.
void product_from_residual(const HalfBlockCsr& K, const float* rhs, const float* r, const float* d, float* out);

// out = K x.
void multiply(const HalfBlockCsr& K, const float* x, float* out);

} // namespace palpate
