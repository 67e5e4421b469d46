#include "linalg/small_dense.h"
#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate {

bool factor(double* A, int* pivot, int n) {
    double most = 0;
    for (int i = 0; i < n * n; i++) most = std::max(most, std::abs(A[i]));
    for (int c = 0; c < n; c++) {
        int p = c;
        for (int i = c + 1; i < n; i++)
            if (std::abs(A[i * n + c]) > std::abs(A[p * n + c])) p = i;
        pivot[c] = p;
        if (!(std::abs(A[p * n + c]) > 1e-12 * most)) return false;
        if (p != c)
            for (int j = 0; j < n; j++) std::swap(A[p * n + j], A[c * n + j]);
        for (int i = c + 1; i < n; i++) {
            const double f = A[i * n + c] /= A[c * n + c];
            for (int j = c + 1; j < n; j++) A[i * n + j] -= f * A[c * n + j];
        }
    }
    return true;
}

void solve_factored(const double* A, const int* pivot, int n, double* x) {
    for (int c = 0; c < n; c++) std::swap(x[c], x[pivot[c]]);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) x[i] -= A[i * n + j] * x[j];
    for (int i = n - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++) x[i] -= A[i * n + j] * x[j];
        x[i] /= A[i * n + i];
    }
}

void solve_transposed(const double* A, const int* pivot, int n, double* x) {
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < i; j++) x[i] -= A[j * n + i] * x[j];
        x[i] /= A[i * n + i];
    }
    for (int i = n - 1; i >= 0; i--)
        for (int j = i + 1; j < n; j++) x[i] -= A[j * n + i] * x[j];
    for (int c = n - 1; c >= 0; c--) std::swap(x[c], x[pivot[c]]);
}

void factor_independent(double* A, int n, double part) {
    for (int i = 0; i < n; i++) {
        const double before = A[i * n + i];
        double left = before;
        for (int j = 0; j < i; j++) {
            double sum = A[i * n + j];
            for (int k = 0; k < j; k++) sum -= A[i * n + k] * A[j * n + k];
            A[i * n + j] = A[j * n + j] > 0 ? sum / A[j * n + j] : 0;
            left -= A[i * n + j] * A[i * n + j];
        }
        if (before > 0 && left > part * before)
            A[i * n + i] = std::sqrt(left);
        else
            std::fill_n(A + i * n, i + 1, 0.0);
    }
}

void solve_positive(const double* L, int n, double* x) {
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < i; j++) x[i] -= L[i * n + j] * x[j];
        x[i] /= L[i * n + i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++) x[i] -= L[j * n + i] * x[j];
        x[i] /= L[i * n + i];
    }
}

bool invert_positive(double* A, int n, double* out) {
    factor_independent(A, n, 1e-6);
    for (int k = 0; k < n; k++)
        if (!(A[k * n + k] > 0)) return false;
    for (int k = 0; k < n; k++) {
        double column[16] = {};
        column[k] = 1;
        solve_positive(A, n, column);
        for (int r = 0; r < n; r++) out[r * n + k] = column[r];
    }
    return true;
}

} // namespace palpate
