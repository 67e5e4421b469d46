#include "relaxation/mode_deflation.h"
#include "base/cpu_dispatch.h"
#include <cmath>
#include <cstddef>
#include <numeric>

namespace palpate {
namespace {

constexpr int count = ModeDeflation::count;

PALPATE_KERNEL void project(const double* load, const double* u, size_t unknowns, double* amplitude) {
    double sum[count] = {};
    for (size_t i = 0; i < unknowns; i++)
        for (int k = 0; k < count; k++) sum[k] += load[count * i + k] * u[i];
    for (int k = 0; k < count; k++) amplitude[k] = sum[k];
}

PALPATE_KERNEL void add(const double* shape, const double* amplitude, size_t unknowns, double* u) {
    double a[count];
    for (int k = 0; k < count; k++) a[k] = amplitude[k];
    for (size_t i = 0; i < unknowns; i++) {
        double sum = 0;
        for (int k = 0; k < count; k++) sum += shape[count * i + k] * a[k];
        u[i] += sum;
    }
}

void remove_part_along(const double* unit, double* v) {
    const double inner = std::inner_product(v, v + count, unit, 0.0);
    for (int k = 0; k < count; k++) v[k] -= inner * unit[k];
}

} // namespace

ModeDeflation::ModeDeflation(const double* s, const double* l, int nodes)
    : shape(s, s + 3 * size_t(nodes) * count), load(l, l + 3 * size_t(nodes) * count) {}

// Gram-Schmidt on the rows W' shape, one per contact and axis; linearly dependent ones are left out.
void ModeDeflation::constrain(const int* contact_nodes, int node_count, const double* weight, int contacts,
                              Constraints& out) const {
    out.rows = 0;
    for (int c = 0; c < contacts; c++)
        for (int axis = 0; axis < 3; axis++) {
            if (out.rows == count) return;
            double* row = out.row[out.rows];
            for (int k = 0; k < count; k++) row[k] = 0;
            for (int at = 0; at < node_count; at++) {
                const double w = weight[size_t(c) * ContactPatch::capacity + at];
                const double* s = &shape[count * (3 * size_t(contact_nodes[at]) + axis)];
                for (int k = 0; k < count; k++) row[k] += w * s[k];
            }
            const double before = std::inner_product(row, row + count, row, 0.0);
            for (int twice = 0; twice < 2; twice++) // again, since once loses digits if rows are nearly parallel
                for (int r = 0; r < out.rows; r++) remove_part_along(out.row[r], row);
            const double after = std::inner_product(row, row + count, row, 0.0);
            if (!(after > 1e-20 * before)) continue;
            for (int k = 0; k < count; k++) row[k] /= std::sqrt(after);
            out.rows++;
        }
}

void ModeDeflation::deflate(const Constraints& constraints, double* u) const {
    const size_t unknowns = shape.size() / count;
    double amplitude[count];
    project(load.data(), u, unknowns, amplitude);
    for (int r = 0; r < constraints.rows; r++) remove_part_along(constraints.row[r], amplitude);
    for (int k = 0; k < count; k++) amplitude[k] = -amplitude[k];
    add(shape.data(), amplitude, unknowns, u);
}

} // namespace palpate
