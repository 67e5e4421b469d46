// The growing factor against a matrix whose factor is known.
#include "cutting/jump_factor.h"
#include <cmath>
#include <doctest.h>
#include <random>
#include <vector>

using palpate::JumpFactor;

namespace {

// M = A S A' of a random lower triangle with a strong diagonal: every pivot has the sign of its row.
struct Known {
    int n;
    std::vector<double> sign, A, M;
    Known(int n, int negative) : n(n), sign(n, 1.0), A(n * n), M(n * n) {
        std::mt19937 random(5);
        std::normal_distribution<double> draw;
        for (int i = 0; i < n; i++) {
            if (i < negative) sign[i] = -1;
            for (int j = 0; j < i; j++) A[i * n + j] = draw(random) / n;
            A[i * n + i] = 1 + std::abs(draw(random));
        }
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                for (int k = 0; k < n; k++) M[i * n + j] += A[i * n + k] * sign[k] * A[j * n + k];
    }
    std::vector<double> rows(int from, int count) const {
        std::vector<double> out;
        for (int i = from; i < from + count; i++) out.insert(out.end(), &M[i * n], &M[i * n] + from + count);
        return out;
    }
};

void fill(JumpFactor& factor, const Known& known, std::vector<int> steps) {
    for (int count : steps)
        CHECK(factor.append(known.rows(factor.size(), count).data(), count, known.sign[factor.size()], 1e-12));
}

} // namespace

TEST_CASE("M x = b, however the rows came") {
    const Known known(23, 9);
    for (const std::vector<int>& steps : {std::vector<int>{9, 14}, {3, 3, 3, 3, 3, 3, 3, 2}, {9, 1, 13}}) {
        JumpFactor factor(23);
        fill(factor, known, steps);
        std::vector<double> b(2 * 23);
        for (int i = 0; i < 46; i++) b[i] = std::cos(i);
        std::vector<double> x = b;
        factor.reduce(x.data(), 2, 0);
        factor.expand(x.data(), 2);
        for (int i = 0; i < 23; i++)
            for (int c = 0; c < 2; c++) {
                double sum = 0;
                for (int j = 0; j < 23; j++) sum += known.M[i * 23 + j] * x[2 * j + c];
                CHECK(sum == doctest::Approx(b[2 * i + c]).epsilon(1e-12));
            }
    }
}

TEST_CASE("rows that come later change no entry of z before them") {
    const Known known(20, 0);
    JumpFactor factor(20);
    fill(factor, known, {12});
    std::vector<double> z(20), again(20);
    for (int i = 0; i < 20; i++) z[i] = again[i] = std::sin(i);
    factor.reduce(z.data(), 1, 0);
    fill(factor, known, {8});
    factor.reduce(z.data(), 1, 12);
    factor.reduce(again.data(), 1, 0);
    for (int i = 0; i < 20; i++) CHECK(z[i] == again[i]);
}

TEST_CASE("a block is the sum of s z z'") {
    const Known known(11, 4);
    JumpFactor factor(11);
    fill(factor, known, {4, 7});
    std::vector<double> z(33), w(33);
    for (int i = 0; i < 33; i++) z[i] = std::sin(i), w[i] = std::cos(i);
    double out[9];
    factor.block(z.data(), w.data(), 11, out);
    double sum = 0;
    for (int k = 0; k < 11; k++) sum += known.sign[k] * z[11 + k] * w[22 + k];
    CHECK(out[5] == doctest::Approx(sum));
}

TEST_CASE("a pivot that vanishes or has the other sign leaves all as it was") {
    const Known known(9, 0);
    JumpFactor factor(9);
    fill(factor, known, {6});
    std::vector<double> rows = known.rows(6, 3);
    for (int j = 0; j < 9; j++) rows[18 + j] = j < 8 ? known.M[7 * 9 + j] : known.M[7 * 9 + 7]; // the row before, again
    CHECK_FALSE(factor.append(rows.data(), 3, 1, 1e-12));
    CHECK_FALSE(factor.append(known.rows(6, 3).data(), 3, -1, 0));
    CHECK(factor.size() == 6);
    CHECK(factor.append(known.rows(6, 3).data(), 3, 1, 1e-12));
}
