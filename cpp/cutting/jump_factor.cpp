#include "cutting/jump_factor.h"
#include "base/cpu_dispatch.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int together = 3; // rows: the unknowns of a node

// Dot products of l with three vectors, which are `stride` apart.
PALPATE_KERNEL void dots(const double* l, const double* y, int stride, int n, double out[together]) {
    constexpr int lanes = 8;
    double sum[together][lanes] = {};
    int j = 0;
    for (; j + lanes <= n; j += lanes)
        for (int c = 0; c < together; c++)
            for (int k = 0; k < lanes; k++) sum[c][k] += l[j + k] * y[size_t(c) * stride + j + k];
    for (int c = 0; c < together; c++) {
        out[c] = 0;
        for (int k = 0; k < lanes; k++) out[c] += sum[c][k];
        for (int k = j; k < n; k++) out[c] += l[k] * y[size_t(c) * stride + k];
    }
}

// The same with s l for l.
PALPATE_KERNEL void signed_dots(const double* s, const double* l, const double* y, int stride, int n,
                                double out[together]) {
    constexpr int lanes = 8;
    double sum[together][lanes] = {};
    int j = 0;
    for (; j + lanes <= n; j += lanes)
        for (int c = 0; c < together; c++)
            for (int k = 0; k < lanes; k++) sum[c][k] += s[j + k] * l[j + k] * y[size_t(c) * stride + j + k];
    for (int c = 0; c < together; c++) {
        out[c] = 0;
        for (int k = 0; k < lanes; k++) out[c] += sum[c][k];
        for (int k = j; k < n; k++) out[c] += s[k] * l[k] * y[size_t(c) * stride + k];
    }
}

} // namespace

JumpFactor::JumpFactor(int capacity) : capacity(capacity), lower(size_t(capacity) * (capacity + 1) / 2) {
    sign.reserve(capacity);
}

bool JumpFactor::append(const double* rows, int count, double s, double least) {
    const int before = size(), stride = before + count;
    for (int k = 0; k < count; k += together) {
        const int some = std::min(together, count - k);
        if (size() + some <= capacity && append_three(rows + size_t(k) * stride, some, stride, s, least)) continue;
        sign.resize(before);
        return false;
    }
    return true;
}

bool JumpFactor::append_three(const double* rows, int count, int stride, double s, double least) {
    const int n = size();
    std::vector<double> y(size_t(together) * n);
    for (int c = 0; c < count; c++) std::copy_n(rows + size_t(c) * stride, n, y.data() + size_t(c) * n);
    for (int i = 0; i < n; i++) { // L (S l) = m
        double sum[together];
        const double* l = row(i);
        dots(l, y.data(), n, i, sum);
        for (int c = 0; c < count; c++) y[size_t(c) * n + i] = (y[size_t(c) * n + i] - sum[c]) / l[i];
    }
    for (int c = 0; c < count; c++) {
        double* l = row(n + c);
        for (int i = 0; i < n; i++) l[i] = sign[i] * y[size_t(c) * n + i];
        for (int d = 0; d <= c; d++) {
            const double* other = row(n + d);
            double pivot = rows[size_t(c) * stride + n + d];
            for (int i = 0; i < n; i++) pivot -= l[i] * y[size_t(d) * n + i];
            for (int i = n; i < n + d; i++) pivot -= s * l[i] * other[i];
            if (d < c)
                l[n + d] = pivot * s / other[n + d];
            else if (!(pivot * s > least * std::abs(rows[size_t(c) * stride + n + c])))
                return false;
            else
                l[n + c] = std::sqrt(pivot * s);
        }
    }
    sign.resize(n + count, s);
    return true;
}

void JumpFactor::reduce(double* b, int columns, int first) const {
    for (int i = first; i < size(); i++) {
        const double* l = row(i);
        double* z = b + size_t(i) * columns;
        for (int j = 0; j < i; j++)
            for (int c = 0; c < columns; c++) z[c] -= l[j] * b[size_t(j) * columns + c];
        for (int c = 0; c < columns; c++) z[c] /= l[i];
    }
}

void JumpFactor::expand(double* z, int columns) const {
    for (int i = 0; i < size(); i++)
        for (int c = 0; c < columns; c++) z[size_t(i) * columns + c] *= sign[i];
    for (int i = size() - 1; i >= 0; i--) {
        const double* l = row(i);
        double* x = z + size_t(i) * columns;
        for (int c = 0; c < columns; c++) x[c] /= l[i];
        for (int j = 0; j < i; j++)
            for (int c = 0; c < columns; c++) z[size_t(j) * columns + c] -= l[j] * x[c];
    }
}

void JumpFactor::block(const double* z_i, const double* z_j, int stride, double out[9]) const {
    for (int a = 0; a < 3; a++) signed_dots(sign.data(), z_i + size_t(a) * stride, z_j, stride, size(), out + 3 * a);
}

} // namespace palpate
