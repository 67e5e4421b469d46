#include "compliance/gap_constraints.h"
#include "base/cpu_dispatch.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// A tool whose patch all but is the surface of a gap moves both as it likes: no force can open that gap.
constexpr float least_pivot = 1e-4f; // of the gap's own compliance
constexpr double on_cone = 1 - 1e-9; // of friction times the force in the gap: surfaces slip

PALPATE_KERNEL void add_scaled(const float* x, float a, int n, float* y) {
    for (int k = 0; k < n; k++) y[k] += a * x[k];
}

PALPATE_KERNEL float dot_product(const float* x, const float* y, int n) {
    constexpr int lanes = 16; // rows are of whole cache lines
    float sum[lanes] = {};
    for (int k = 0; k < n; k += lanes)
        for (int l = 0; l < lanes; l++) sum[l] += x[k + l] * y[k + l];
    float all = 0;
    for (float one : sum) all += one;
    return all;
}

} // namespace

void GapConstraints::add_displacement(const float* p, float* out) const {
    for (size_t k = 0; k < response.size() / stride; k++) out[k] += dot_product(&response[k * stride], p, stride);
}

void GapConstraints::add_load(const double* p, double* load) const {
    for (int i = 0; i < rows; i++)
        for (int k = first[i]; k < first[i + 1]; k++)
            for (int c = 0; c < 3; c++) load[3 * size_t(node[k]) + c] += p[i] * share[3 * size_t(k) + c];
}

// Half of each force times the way that it holds: a gap that is closed by all of its rest, the slip where it sticks.
double GapConstraints::energy(const double* p) const {
    double sum = 0;
    for (int i = 0; i < count; i++) sum -= 0.5 * rest[i] * p[i];
    for (int i = count; i < rows; i++) sum += 0.5 * p[i] * p[rows + i - count];
    return sum;
}

GapSolver::GapSolver(const GapConstraints& gaps, int patches)
    : gaps(gaps), moved(3 * size_t(patches) * gaps.stride), stiff(moved.size()), matrix(gaps.between.size()),
      gap(gaps.stride), known(gaps.rows) {}

void GapSolver::set_patch(int patch, const int* vertices, const double* weight, int count) {
    const size_t stride = gaps.stride, three = 3 * stride;
    float* out = &moved[three * patch];
    std::fill_n(out, three, 0.0f);
    for (int i = 0; i < count; i++)
        if (weight[i] != 0) add_scaled(&gaps.response[three * vertices[i]], float(weight[i]), int(three), out);
}

void GapSolver::patch_displacement(int patch, const double* p, double out[3]) const {
    for (int c = 0; c < 3; c++) {
        out[c] = 0;
        for (int i = 0; i < gaps.rows; i++) out[c] += double(moved[size_t(3 * patch + c) * gaps.stride + i]) * p[i];
    }
}

const float* GapSolver::row(int i, int n) {
    float* out = &matrix[size_t(i) * gaps.stride];
    if (known[i]) return out;
    known[i] = 1;
    std::copy_n(&gaps.between[size_t(i) * gaps.stride], gaps.stride, out);
    for (int k = 0; k < n; k++) {
        const size_t at = size_t(k) * gaps.stride;
        add_scaled(&moved[at], -stiff[at + i], gaps.stride, out);
    }
    return out;
}

// One step of projected Gauss-Seidel of a gap's force; whether it has changed.
bool GapSolver::press(int i, int n, double* p) {
    const double give = gaps.give[i];
    if (give == 0 && p[i] == 0 && gap[i] >= 0) return false;
    const float* m = row(i, n);
    if (!(m[i] > least_pivot * gaps.between[size_t(i) * gaps.stride + i])) return false;
    double next = p[i] - (double(gap[i]) + give * p[i]) / (double(m[i]) + give);
    if (give == 0) next = std::max(0.0, next);
    const double step = next - p[i];
    if (step == 0) return false;
    add_scaled(m, float(step), gaps.stride, gap.data());
    p[i] = next;
    return true;
}

// The same of its friction: towards no slip since the surfaces stuck, then back into Coulomb's cone. The step is that
// for the more compliant direction.
bool GapSolver::rub(int i, int n, double* p) {
    const int r = gaps.count + 2 * i;
    double* q = p + r;
    const double *stuck = p + gaps.rows + 2 * i, cone = gaps.friction * p[i];
    if (cone == 0 && q[0] == 0 && q[1] == 0) return false;
    double next[2] = {0, 0};
    const float *a = row(r, n), *b = row(r + 1, n);
    const double half = 0.5 * (double(a[r]) - b[r + 1]);
    const double most = 0.5 * (double(a[r]) + b[r + 1]) + std::sqrt(half * half + double(a[r + 1]) * a[r + 1]);
    if (cone > 0 && most > least_pivot * gaps.between[size_t(r) * gaps.stride + r]) {
        for (int k = 0; k < 2; k++) next[k] = q[k] - (double(gap[r + k]) - stuck[k]) / most;
        const double size = std::hypot(next[0], next[1]);
        if (size > cone)
            for (double& force : next) force *= cone / size;
    }
    if (next[0] == q[0] && next[1] == q[1]) return false;
    add_scaled(a, float(next[0] - q[0]), gaps.stride, gap.data());
    add_scaled(b, float(next[1] - q[1]), gaps.stride, gap.data());
    q[0] = next[0], q[1] = next[1];
    return true;
}

// Surfaces that slip, or are apart, will stick where they are now. Returns the energy of their slip, N mm.
double GapSolver::stick(double* p) const {
    double lost = 0;
    for (int i = 0; i < gaps.count; i++) {
        const int r = gaps.count + 2 * i;
        double* stuck = p + gaps.rows + 2 * i;
        if (std::hypot(p[r], p[r + 1]) < on_cone * gaps.friction * p[i]) continue;
        for (int k = 0; k < 2; k++) {
            lost -= p[r + k] * (double(gap[r + k]) - stuck[k]);
            stuck[k] = gap[r + k];
        }
    }
    return lost;
}

double GapSolver::solve(const double* stiffness, const double* displacement, int n, int sweeps, double* p) {
    const int stride = gaps.stride;
    std::fill(known.begin(), known.end(), uint8_t(0));
    std::fill_n(stiff.begin(), size_t(n) * stride, 0.0f);
    std::fill(gap.begin(), gap.end(), 0.0f);
    for (int i = 0; i < gaps.count; i++) gap[i] = float(gaps.rest[i]);
    for (int k = 0; k < n; k++) {
        float* out = &stiff[size_t(k) * stride];
        for (int c = 0; c < n; c++) add_scaled(&moved[size_t(c) * stride], float(stiffness[n * k + c]), stride, out);
        add_scaled(out, float(displacement[k]), stride, gap.data());
    }
    for (int i = 0; i < gaps.rows; i++)
        if (p[i] != 0) add_scaled(row(i, n), float(p[i]), stride, gap.data());
    for (int sweep = 0; sweep < sweeps; sweep++) {
        bool changed = false;
        for (int k = 0; k < gaps.count; k++) {
            const int i = sweep % 2 == 0 ? k : gaps.count - 1 - k;
            if (press(i, n, p)) changed = true;
            if (gaps.rubs() && gaps.give[i] == 0 && rub(i, n, p)) changed = true;
        }
        if (!changed) break;
    }
    return gaps.rubs() ? stick(p) : 0;
}

} // namespace palpate
