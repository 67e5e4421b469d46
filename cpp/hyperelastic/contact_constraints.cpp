#include "hyperelastic/contact_constraints.h"
#include "linalg/lbfgs.h"
#include <algorithm>
#include <cmath>

namespace palpate {

ContactConstraints::ContactConstraints(int nodes, int max_contacts)
    : n(3 * nodes), patch(max_contacts), columns(size_t(3 * max_contacts) * n),
      inverse(9 * size_t(max_contacts) * max_contacts), work(18 * size_t(max_contacts) * max_contacts),
      mean(3 * max_contacts) {}

bool ContactConstraints::set_patches(const ContactPatch* patches, int count, RestStiffness& rest) {
    bool same = count == contacts && independent;
    for (int c = 0; c < count && same; c++)
        same = patches[c].count == patch[c].count &&
               std::equal(patches[c].node, patches[c].node + patch[c].count, patch[c].node) &&
               std::equal(patches[c].weight, patches[c].weight + patch[c].count, patch[c].weight);
    if (same) return false;
    contacts = count;
    for (int c = 0; c < count; c++) {
        patch[c] = patches[c];
        rest.solve_patch(patch[c], &columns[size_t(3 * c) * n]);
    }
    independent = invert();
    return true;
}

// The inverse of the small C = W'K^-1 W by Gauss-Jordan elimination with partial pivoting. C is not quite symmetric,
// since K^-1 W is rounded; leaving it so makes project() and least_energy_move() exact.
bool ContactConstraints::invert() {
    const int m = 3 * contacts, width = 2 * m;
    for (int column = 0; column < m; column++) {
        patch_means(&columns[size_t(column) * n], mean.data());
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
        const double scale = 1 / work[k * width + k];
        for (int j = 0; j < width; j++) work[k * width + j] *= scale;
        for (int row = 0; row < m; row++)
            if (const double f = work[row * width + k]; row != k && f != 0)
                for (int j = 0; j < width; j++) work[row * width + j] -= f * work[k * width + j];
    }
    for (int row = 0; row < m; row++) std::copy_n(&work[row * width + m], m, &inverse[row * m]);
    return true;
}

void ContactConstraints::patch_means(const double* u, double* out) const {
    for (int c = 0; c < contacts; c++) patch[c].mean(u, out + 3 * c);
}

// out += sign K^-1 W C^-1 gap
void ContactConstraints::add_move(double sign, const double* gap, double* out) const {
    const int m = 3 * contacts;
    for (int row = 0; row < m; row++) {
        double f = 0;
        for (int j = 0; j < m; j++) f += inverse[row * m + j] * gap[j];
        add(sign * f, &columns[size_t(row) * n], out, n);
    }
}

void ContactConstraints::least_energy_move(const double* gap, double* out) const {
    std::fill_n(out, n, 0.0);
    add_move(1, gap, out);
}

void ContactConstraints::rest_stiffness(double* out) const {
    const int m = 3 * contacts;
    for (int i = 0; i < m; i++)
        for (int j = 0; j < m; j++) out[i * m + j] = 0.5 * (inverse[i * m + j] + inverse[j * m + i]);
}

void ContactConstraints::project(double* v) const {
    patch_means(v, mean.data());
    add_move(-1, mean.data(), v);
}

void ContactConstraints::subtract_tool_forces(double* g, double* force) const {
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
