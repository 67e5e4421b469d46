#include "linalg/saddle_point.h"
#include "base/vec3.h"
#include <cmath>
#include <cstddef>

namespace palpate {
namespace {

// In place, lower triangle of row-major A; false when a pivot is lost to rounding.
PALPATE_KERNEL bool cholesky(double* A, int n) {
    for (int i = 0; i < n; i++) {
        double* row = A + size_t(i) * n;
        double before = row[i];
        for (int j = 0; j < i; j++) {
            const double* other = A + size_t(j) * n;
            row[j] = (row[j] - dot(row, other, j)) / other[j];
        }
        double left = before - dot(row, row, i);
        if (!(left > 1e-12 * before)) return false;
        row[i] = std::sqrt(left);
    }
    return true;
}

PALPATE_KERNEL void substitute(const double* L, int n, double* x) {
    for (int i = 0; i < n; i++) x[i] = (x[i] - dot(L + size_t(i) * n, x, i)) / L[size_t(i) * n + i];
    for (int i = n - 1; i >= 0; i--) {
        const double* row = L + size_t(i) * n;
        double xi = x[i] /= row[i];
        for (int j = 0; j < i; j++) x[j] -= row[j] * xi;
    }
}

PALPATE_KERNEL double inner(const double* a, const double* b, int n) { return dot(a, b, n); }

} // namespace

SaddlePoint::SaddlePoint(int unknowns, int constraints)
    : L(size_t(unknowns) * unknowns), W(size_t(constraints) * unknowns), Z(W.size()),
      S(size_t(constraints) * constraints) {}

double* SaddlePoint::matrix(int unknowns) {
    n = unknowns;
    return L.data();
}

double* SaddlePoint::constraints(int count) {
    m = count;
    return W.data();
}

void SaddlePoint::factor() { cholesky(L.data(), n); }

bool SaddlePoint::factor_constraints() {
    for (int a = 0; a < m; a++) {
        double* z = &Z[size_t(a) * n];
        for (int i = 0; i < n; i++) z[i] = W[size_t(a) * n + i];
        substitute(L.data(), n, z);
    }
    for (int a = 0; a < m; a++)
        for (int b = 0; b <= a; b++) S[size_t(a) * m + b] = inner(&W[size_t(a) * n], &Z[size_t(b) * n], n);
    return cholesky(S.data(), m);
}

void SaddlePoint::solve(double* g, double* d) const {
    substitute(L.data(), n, g);
    for (int a = 0; a < m; a++) d[a] -= inner(&W[size_t(a) * n], g, n);
    substitute(S.data(), m, d);
    for (int a = 0; a < m; a++)
        for (int i = 0; i < n; i++) g[i] += Z[size_t(a) * n + i] * d[a];
}

} // namespace palpate
