// A random symmetric positive definite matrix of 3x3 node blocks, dense and in rows, with float64 solves for
// references.
#pragma once
#include "linalg/block_csr.h"
#include <cmath>
#include <random>
#include <vector>

namespace palpate {

struct RandomBlocks {
    int nodes, n; // n = 3 nodes
    std::vector<double> dense;
    double operator()(int i, int j) const { return dense[size_t(i) * n + j]; }

    // The sum of random 9x9 matrices G'G over triples of nearby nodes, like elements.
    explicit RandomBlocks(int count, unsigned seed = 1) : nodes(count), n(3 * count), dense(size_t(n) * n, 0.0) {
        std::mt19937 random(seed);
        std::normal_distribution<double> normal;
        for (int e = 0; e < 3 * nodes; e++) {
            const int first = e % nodes;
            const int node[3] = {first, int((first + 1 + random() % 4) % nodes),
                                 int((first + 5 + random() % 6) % nodes)};
            double G[9][9];
            for (auto& row : G)
                for (double& x : row) x = normal(random);
            for (int p = 0; p < 9; p++)
                for (int q = 0; q < 9; q++)
                    for (int k = 0; k < 9; k++)
                        dense[size_t(3 * node[p / 3] + p % 3) * n + 3 * node[q / 3] + q % 3] += G[k][p] * G[k][q];
        }
    }

    BlockCsr rows() const {
        BlockCsr K;
        for (int i = 0; i < nodes; i++) {
            for (int j = 0; j < nodes; j++) {
                bool any = false;
                for (int k = 0; k < 9; k++) any = any || (*this)(3 * i + k / 3, 3 * j + k % 3) != 0;
                if (!any) continue;
                K.column.push_back(j);
                for (int k = 0; k < 9; k++) K.block.push_back((*this)(3 * i + k / 3, 3 * j + k % 3));
            }
            K.start.push_back(int(K.column.size()));
        }
        return K;
    }

    std::vector<double> times(const std::vector<double>& x) const {
        std::vector<double> y(n, 0.0);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) y[i] += (*this)(i, j) * x[j];
        return y;
    }

    std::vector<double> vector(unsigned seed) const {
        std::mt19937 random(seed);
        std::normal_distribution<double> normal;
        std::vector<double> x(n);
        for (double& v : x) v = normal(random);
        return x;
    }
};

// Gaussian elimination with partial pivoting: x of A x = b, A (n, n).
inline std::vector<double> solve_dense(std::vector<double> A, std::vector<double> b) {
    const int n = int(b.size());
    for (int k = 0; k < n; k++) {
        int pivot = k;
        for (int i = k + 1; i < n; i++)
            if (std::abs(A[size_t(i) * n + k]) > std::abs(A[size_t(pivot) * n + k])) pivot = i;
        for (int j = 0; j < n; j++) std::swap(A[size_t(k) * n + j], A[size_t(pivot) * n + j]);
        std::swap(b[k], b[pivot]);
        for (int i = k + 1; i < n; i++) {
            const double f = A[size_t(i) * n + k] / A[size_t(k) * n + k];
            for (int j = k; j < n; j++) A[size_t(i) * n + j] -= f * A[size_t(k) * n + j];
            b[i] -= f * b[k];
        }
    }
    for (int k = n - 1; k >= 0; k--) {
        for (int j = k + 1; j < n; j++) b[k] -= A[size_t(k) * n + j] * b[j];
        b[k] /= A[size_t(k) * n + k];
    }
    return b;
}

} // namespace palpate
