#include "multigrid/v_cycle.h"
#include "base/simd.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int max_dense_nodes = 100; // up to so many, a dense inverse is cheaper than another level

// out = P' v; out is zero on entry.
PALPATE_KERNEL void restrict(int nodes, const int* parent, const float* weight, const float* v, float* out) {
    for (int i = 0; i < nodes; i++) {
        f32x4 x, to;
        load(x, v + 4 * size_t(i));
        for (int k = 0; k < 8; k++) {
            float* at = out + parent[8 * size_t(i) + k];
            load(to, at);
            store(at, to + weight[8 * size_t(i) + k] * x);
        }
    }
}

PALPATE_KERNEL void prolong(int nodes, const int* parent, const float* weight, const float* v, float* out) {
    for (int i = 0; i < nodes; i++) {
        f32x4 sum = {}, x;
        for (int k = 0; k < 8; k++) {
            load(x, v + parent[8 * size_t(i) + k]);
            sum += weight[8 * size_t(i) + k] * x;
        }
        store(out + 4 * size_t(i), sum);
    }
}

// out = A v, A of `rows` rows of `row` floats, a multiple of eight; v padded with zeros.
PALPATE_KERNEL void dense_product(const float* A, int rows, int row, const float* v, float* out) {
    for (int i = 0; i < rows; i++) {
        f32x8 sum = {}, more = {}, a, b;
        const float* from = A + size_t(i) * row;
        for (int j = 0; j < row; j += 16) {
            load(a, from + j), load(b, v + j), sum += a * b;
            load(a, from + j + 8), load(b, v + j + 8), more += a * b;
        }
        sum += more;
        out[i] = total(sum);
    }
}

// A = A^-1 for symmetric positive definite A, by Cholesky.
void invert_spd(std::vector<double>& A, int n) {
    auto at = [&](int i, int j) -> double& { return A[size_t(i) * n + j]; };
    for (int i = 0; i < n; i++) {
        const double before = at(i, i);
        for (int j = 0; j <= i; j++) {
            double sum = at(i, j);
            for (int k = 0; k < j; k++) sum -= at(i, k) * at(j, k);
            // A pivot lost to rounding is a free motion: a large pivot keeps it at zero.
            at(i, j) = j < i ? sum / at(j, j) : std::sqrt(sum > 1e-10 * before ? sum : 1e30 * (before + 1e-30));
        }
    }
    std::vector<double> inverse(A.size());
    std::vector<double> x(n);
    for (int c = 0; c < n; c++) {
        std::fill(x.begin(), x.end(), 0.0);
        x[c] = 1;
        for (int i = c; i < n; i++) {
            for (int k = c; k < i; k++) x[i] -= at(i, k) * x[k];
            x[i] /= at(i, i);
        }
        for (int i = n - 1; i >= 0; i--) {
            x[i] /= at(i, i);
            for (int k = 0; k < i; k++) x[k] -= at(i, k) * x[i];
        }
        for (int i = 0; i < n; i++) inverse[size_t(i) * n + c] = x[i];
    }
    A.swap(inverse);
}

} // namespace

VCycle::VCycle(const BlockCsr& K, const ElasticMesh& mesh, double edge, int s, double omega)
    : sweeps(s), relaxation(float(omega)) {
    level.push_back({HalfBlockCsr(K, mesh.fixed), {}});
    CoarseLattice lattice(mesh, edge, level.back().up);
    while (lattice.nodes() > max_dense_nodes) {
        level.push_back({HalfBlockCsr(lattice.stiffness(), nullptr), {}});
        lattice = lattice.coarsen(level.back().up);
    }
    coarsest_nodes = lattice.nodes();
    invert_coarsest(lattice.stiffness());
}

void VCycle::invert_coarsest(const BlockCsr& K) {
    const int n = 3 * coarsest_nodes;
    std::vector<double> A(size_t(n) * n);
    for (int i = 0; i < coarsest_nodes; i++)
        for (int k = K.start[i]; k < K.start[i + 1]; k++)
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++)
                    A[size_t(3 * i + a) * n + 3 * K.column[k] + b] = K.block[9 * size_t(k) + 3 * a + b];
    invert_spd(A, n);
    row = (4 * coarsest_nodes + 15) / 16 * 16; // in the layout of the vectors, four per node
    dense.assign(size_t(4 * coarsest_nodes) * row, 0);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            dense[size_t(i / 3 * 4 + i % 3) * row + j / 3 * 4 + j % 3] =
                float((A[size_t(i) * n + j] + A[size_t(j) * n + i]) / 2);
}

VCycleWorkspace VCycle::make_workspace() const {
    VCycleWorkspace work;
    for (const Level& l : level) {
        const size_t n = 4 * size_t(l.K.nodes());
        VCycleWorkspace::Level w;
        for (AlignedBuffer* b : {&w.rhs, &w.x, &w.step, &w.even, &w.odd, &w.correction}) b->assign(n, 0);
        work.level.push_back(std::move(w));
    }
    work.rhs.assign(row, 0);
    work.x.assign(row, 0);
    return work;
}

std::vector<int> VCycle::level_sizes() const {
    std::vector<int> out;
    for (const Level& l : level) out.push_back(l.K.nodes());
    out.push_back(coarsest_nodes);
    return out;
}

double VCycle::bytes_moved(int fine_sweeps) const {
    double sum = 4.0 * dense.size();
    for (const Level& l : level) {
        const bool finest = &l == level.data();
        const int count = finest ? fine_sweeps : sweeps;
        const double half = 4.0 * (l.K.block.size() + l.K.column.size() + l.K.start.size());
        sum += (2 * count + finest) * half + 4.0 * (2 * count * l.K.inverse.size() + l.K.diagonal.size());
        sum += 2 * 4.0 * (l.up.parent.size() + l.up.weight.size());
        sum += 16.0 * l.K.nodes() * (11 * count + 2 + (finest ? 4 : 0)); // vectors of the sweeps
    }
    return sum;
}

void VCycle::apply(VCycleWorkspace& work, int fine_sweeps, const float* rhs, float* x, float* product) const {
    VCycleWorkspace::Level& w = work.level[0];
    cycle(work, 0, fine_sweeps, rhs, x);
    // cycle() leaves the residual plus L d in `even` or `odd`, by the number of sweeps.
    product_from_residual(level[0].K, rhs, (fine_sweeps % 2 ? w.even : w.odd).data(), w.step.data(), product);
}

void VCycle::apply_coarse(VCycleWorkspace& work, const float* rhs, float* x) const {
    coarse_correction(work, 0, rhs, x);
}

void VCycle::coarse_correction(VCycleWorkspace& work, size_t k, const float* r, float* out) const {
    const Level& l = level[k];
    const bool last = k + 1 == level.size();
    AlignedBuffer& to = last ? work.rhs : work.level[k + 1].rhs;
    std::fill(to.begin(), to.end(), 0.0f);
    restrict(l.K.nodes(), l.up.parent.data(), l.up.weight.data(), r, to.data());
    float* coarse = (last ? work.x : work.level[k + 1].x).data();
    if (last)
        dense_product(dense.data(), 4 * coarsest_nodes, row, to.data(), coarse);
    else
        cycle(work, k + 1, sweeps, to.data(), coarse);
    prolong(l.K.nodes(), l.up.parent.data(), l.up.weight.data(), coarse, out);
}

void VCycle::cycle(VCycleWorkspace& work, size_t k, int level_sweeps, const float* r, float* x) const {
    const Level& l = level[k];
    VCycleWorkspace::Level& w = work.level[k];
    AlignedBuffer *now = &w.even, *next = &w.odd;
    for (int s = 0; s < level_sweeps; s++) {
        sor_forward(l.K, relaxation, r, w.step.data(), now->data(), x, s == 0);
        r = now->data();
        std::swap(now, next);
    }
    std::swap(now, next); // now: the residual; next: unused
    coarse_correction(work, k, r, w.correction.data());
    for (int s = 0; s < level_sweeps; s++) {
        std::fill(next->begin(), next->end(), 0.0f);
        if (s == 0)
            sor_backward_first(l.K, relaxation, w.correction.data(), now->data(), w.step.data(), next->data(), x);
        else
            sor_backward(l.K, relaxation, now->data(), w.step.data(), next->data(), x);
    }
}

} // namespace palpate
