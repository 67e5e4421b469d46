#include "tools.h"
#include "pairs.h"
#include <algorithm>
#include <cmath>
#include <numeric>

namespace palpate {

RestSolve::RestSolve(const Supernodes& tree, const float* value, const std::vector<int>& moving, int nodes)
    : tree(tree), value(value), moving(moving), nodes(nodes), place(nodes, -1), all(tree.count()), one(tree, 1),
      eight(tree, value, 8), wanted(tree.nodes()), touched(Patch::capacity), load(3 * 8 * Patch::capacity),
      answer(3 * 8 * size_t(tree.nodes())) {
    for (size_t k = 0; k < moving.size(); k++) place[moving[k]] = int(k);
    std::iota(all.begin(), all.end(), 0);
    std::iota(wanted.begin(), wanted.end(), 0);
}

void RestSolve::solve(const double* load, double* out) {
    double largest = 0; // the numbers are brought near 1: floats end at 1e-38
    for (int i = 0; i < 3 * nodes; i++) largest = std::max(largest, std::abs(load[i]));
    const double scale = largest > 0 ? 1 / largest : 0;
    for (size_t k = 0; k < moving.size(); k++)
        for (int c = 0; c < 3; c++) one.x[3 * tree.place[k] + c] = float(scale * load[3 * size_t(moving[k]) + c]);
    one.forward_one(value, all.data(), int(all.size()));
    one.backward_one(value, all.data(), int(all.size()));
    std::fill_n(out, 3 * size_t(nodes), 0.0);
    for (size_t k = 0; k < moving.size(); k++)
        for (int c = 0; c < 3; c++) out[3 * size_t(moving[k]) + c] = largest * one.x[3 * tree.place[k] + c];
}

void RestSolve::spread(const Patch& patch, double* out) {
    for (int i = 0; i < patch.count; i++) {
        touched[i] = place[patch.node[i]];
        std::fill_n(&load[24 * i], 24, 0.0f);
        for (int c = 0; c < 3; c++) load[24 * i + 8 * c + c] = float(patch.weight[i]);
    }
    eight.solve(touched.data(), patch.count, load.data(), wanted.data(), int(wanted.size()), answer.data(), 3);
    std::fill_n(out, 9 * size_t(nodes), 0.0);
    for (size_t k = 0; k < moving.size(); k++)
        for (int axis = 0; axis < 3; axis++)
            for (int c = 0; c < 3; c++) out[3 * (size_t(axis) * nodes + moving[k]) + c] = answer[24 * k + 8 * c + axis];
}

Tools::Tools(int nodes, int most)
    : n(3 * nodes), most(most), patch(most), columns(size_t(3 * most) * n), inverse(9 * size_t(most) * most),
      work(18 * size_t(most) * most), mean(3 * most) {}

bool Tools::take(const Patch* patches, int count, RestSolve& rest) {
    bool same = count == contacts && sound;
    for (int c = 0; c < count && same; c++)
        same = patches[c].count == patch[c].count &&
               std::equal(patches[c].node, patches[c].node + patch[c].count, patch[c].node) &&
               std::equal(patches[c].weight, patches[c].weight + patch[c].count, patch[c].weight);
    if (same) return false;
    contacts = count;
    for (int c = 0; c < count; c++) {
        patch[c] = patches[c];
        rest.spread(patch[c], &columns[size_t(3 * c) * n]);
    }
    sound = invert();
    return true;
}

// C = W'K^-1 W by its inverse, since C is small: Gauss-Jordan with the largest pivot of each column. C is symmetric but
// for rounding in K^-1 W; keeping it as it is makes `still` and `reach` exact.
bool Tools::invert() {
    const int m = 3 * contacts, width = 2 * m;
    for (int column = 0; column < m; column++) {
        means(&columns[size_t(column) * n], mean.data());
        for (int row = 0; row < m; row++) {
            work[row * width + column] = mean[row];
            work[row * width + m + column] = row == column;
        }
    }
    double largest = 0;
    for (int row = 0; row < m; row++) largest = std::max(largest, std::abs(work[row * width + row]));
    for (int k = 0; k < m; k++) {
        int pivot = k;
        for (int row = k + 1; row < m; row++)
            if (std::abs(work[row * width + k]) > std::abs(work[pivot * width + k])) pivot = row;
        if (!(std::abs(work[pivot * width + k]) > 1e-4 * largest)) return false;
        if (pivot != k) std::swap_ranges(&work[k * width], &work[k * width] + width, &work[pivot * width]);
        const double by = 1 / work[k * width + k];
        for (int j = 0; j < width; j++) work[k * width + j] *= by;
        for (int row = 0; row < m; row++)
            if (const double f = work[row * width + k]; row != k && f != 0)
                for (int j = 0; j < width; j++) work[row * width + j] -= f * work[k * width + j];
    }
    for (int row = 0; row < m; row++) std::copy_n(&work[row * width + m], m, &inverse[row * m]);
    return true;
}

void Tools::means(const double* u, double* out) const {
    std::fill_n(out, 3 * contacts, 0.0);
    for (int c = 0; c < contacts; c++)
        for (int i = 0; i < patch[c].count; i++)
            for (int k = 0; k < 3; k++) out[3 * c + k] += patch[c].weight[i] * u[3 * size_t(patch[c].node[i]) + k];
}

void Tools::reach(const double* gap, double* out) const {
    const int m = 3 * contacts;
    std::fill_n(out, n, 0.0);
    for (int row = 0; row < m; row++) {
        double f = 0;
        for (int j = 0; j < m; j++) f += inverse[row * m + j] * gap[j];
        add(f, &columns[size_t(row) * n], out, n);
    }
}

void Tools::still(double* v) const {
    const int m = 3 * contacts;
    means(v, mean.data());
    for (int row = 0; row < m; row++) {
        double f = 0;
        for (int j = 0; j < m; j++) f += inverse[row * m + j] * mean[j];
        add(-f, &columns[size_t(row) * n], v, n);
    }
}

void Tools::release(double* g, double* force) const {
    const int m = 3 * contacts;
    for (int j = 0; j < m; j++) mean[j] = inner(&columns[size_t(j) * n], g, n);
    for (int row = 0; row < m; row++) {
        force[row] = 0;
        for (int j = 0; j < m; j++) force[row] += inverse[j * m + row] * mean[j];
    }
    for (int c = 0; c < contacts; c++)
        for (int i = 0; i < patch[c].count; i++)
            for (int k = 0; k < 3; k++) g[3 * size_t(patch[c].node[i]) + k] -= patch[c].weight[i] * force[3 * c + k];
}

} // namespace palpate
