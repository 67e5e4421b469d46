#include "multigrid.h"
#include "dispatch.h"
#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate {
namespace {

constexpr int refreshed = 64; // ticks in which every row of K u is made anew
constexpr double tiny = 1e-12;

PALPATE_KERNEL void rows_times(const int* start, const int* column, const double* block, int first, int last,
                               const double* u, int stride, double* out) {
    for (int i = first; i < last; i++) {
        double sum[3] = {0, 0, 0};
        for (int k = start[i]; k < start[i + 1]; k++) {
            const double *b = block + 9 * size_t(k), *v = u + size_t(stride) * column[k];
            for (int a = 0; a < 3; a++) sum[a] += b[3 * a] * v[0] + b[3 * a + 1] * v[1] + b[3 * a + 2] * v[2];
        }
        for (int a = 0; a < 3; a++) out[size_t(stride) * i + a] = sum[a];
    }
}

// Gaussian elimination with row exchanges, in place; false when a pivot is lost.
bool factor(double* A, int* pivot, int n) {
    double most = 0;
    for (int i = 0; i < n * n; i++) most = std::max(most, std::abs(A[i]));
    for (int c = 0; c < n; c++) {
        int p = c;
        for (int i = c + 1; i < n; i++)
            if (std::abs(A[i * n + c]) > std::abs(A[p * n + c])) p = i;
        pivot[c] = p;
        if (!(std::abs(A[p * n + c]) > tiny * most)) return false;
        if (p != c)
            for (int j = 0; j < n; j++) std::swap(A[p * n + j], A[c * n + j]);
        for (int i = c + 1; i < n; i++) {
            double f = A[i * n + c] /= A[c * n + c];
            for (int j = c + 1; j < n; j++) A[i * n + j] -= f * A[c * n + j];
        }
    }
    return true;
}

// x = A^-1 x
void solve_factored(const double* A, const int* pivot, int n, double* x) {
    for (int c = 0; c < n; c++) std::swap(x[c], x[pivot[c]]);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) x[i] -= A[i * n + j] * x[j];
    for (int i = n - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++) x[i] -= A[i * n + j] * x[j];
        x[i] /= A[i * n + i];
    }
}

// x = A'^-1 x
void solve_transposed(const double* A, const int* pivot, int n, double* x) {
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < i; j++) x[i] -= A[j * n + i] * x[j];
        x[i] /= A[i * n + i];
    }
    for (int i = n - 1; i >= 0; i--)
        for (int j = i + 1; j < n; j++) x[i] -= A[j * n + i] * x[j];
    for (int c = n - 1; c >= 0; c--) std::swap(x[c], x[pivot[c]]);
}

// Cholesky of the lower triangle, in place; a row that adds less than `part` of itself is left out (its pivot is 0).
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
        if (before > 0 && left > part * before) {
            A[i * n + i] = std::sqrt(left);
        } else {
            for (int j = 0; j <= i; j++) A[i * n + j] = 0;
        }
    }
}

Column column(const Field& f) { return {f.data(), nullptr}; }
Column column(const Buffer& f) { return {nullptr, f.data()}; }

} // namespace

void MultigridState::rest() {
    State::rest();
    for (Field& f : field) std::fill(f.begin(), f.end(), 0.0);
    for (Field& f : image) std::fill(f.begin(), f.end(), 0.0);
    kept = newest = contacts = lifts = 0;
}

Multigrid::Multigrid(const Elements& mesh, double cell, int sweeps, double relaxation)
    : K(stiffness(mesh)), held(mesh.held, mesh.held + mesh.nodes), place(mesh.node, mesh.node + 3 * size_t(mesh.nodes)),
      cycle(K, mesh, cell, sweeps, relaxation) {}

std::unique_ptr<State> Multigrid::start() const {
    auto s = std::make_unique<MultigridState>();
    const size_t n = 4 * size_t(nodes());
    s->u.assign(3 * size_t(nodes()), 0);
    for (Field* f : {&s->p, &s->image_p}) f->assign(n, 0);
    for (int k = 0; k < MultigridState::history; k++) s->field[k].assign(n, 0), s->image[k].assign(n, 0);
    for (Buffer* b : {&s->rhs, &s->z, &s->image_z}) b->assign(n, 0);
    s->work = cycle.work();
    remember(*s, 1);
    s->owner = this;
    return s;
}

// Room for so many contacts.
void Multigrid::remember(MultigridState& s, int contacts) const {
    const size_t m = 3 * size_t(contacts), span = m + MultigridState::history;
    if (s.lift.size() >= m) return;
    for (size_t c = s.lift.size(); c < m; c++) {
        s.lift.emplace_back(4 * size_t(nodes()));
        s.image_lift.emplace_back(4 * size_t(nodes()));
    }
    s.patch.resize(contacts);
    s.lift_at.resize(3 * m);
    s.lever.resize(m * m);
    s.pivot.resize(m);
    s.gram.resize(span * span);
    s.scratch.resize(2 * span * fields_block);
    s.small.resize(span * m + m * m + 3 * span + 3 * m);
}

void Multigrid::centre(const Patch& patch, double at[3], double& spread) const {
    at[0] = at[1] = at[2] = spread = 0;
    for (int k = 0; k < patch.count; k++)
        for (int a = 0; a < 3; a++) at[a] += patch.weight[k] * place[3 * size_t(patch.node[k]) + a];
    for (int k = 0; k < patch.count; k++)
        for (int a = 0; a < 3; a++) {
            const double away = place[3 * size_t(patch.node[k]) + a] - at[a];
            spread += patch.weight[k] * away * away;
        }
}

// Z and K Z of one contact along one axis.
void Multigrid::lift(MultigridState& s, int contact, int axis) const {
    const Patch& patch = s.patch[contact];
    Buffer &Z = s.lift[3 * contact + axis], &KZ = s.image_lift[3 * contact + axis];
    std::fill(s.rhs.begin(), s.rhs.end(), 0.0f);
    for (int k = 0; k < patch.count; k++)
        if (!held[patch.node[k]]) s.rhs[4 * size_t(patch.node[k]) + axis] = float(patch.weight[k]);
    cycle.apply_coarse(s.work, s.rhs.data(), Z.data());
    std::fill(KZ.begin(), KZ.end(), 0.0f);
    multiply(cycle.fine(), Z.data(), KZ.data());
    double spread;
    centre(patch, &s.lift_at[3 * (3 * contact + axis)], spread);
}

// One contact, in a loop: all lifts where it lands, then the one left farthest behind once it is half a radius off.
void Multigrid::keep_lifts(MultigridState& s) const {
    double at[3], spread, farthest = -1;
    int axis = 0;
    centre(s.patch[0], at, spread);
    for (int k = 0; k < 3 && s.lifts == 1; k++) {
        double away = 0;
        for (int a = 0; a < 3; a++) away += (at[a] - s.lift_at[3 * k + a]) * (at[a] - s.lift_at[3 * k + a]);
        if (away > farthest) farthest = away, axis = k;
    }
    if (s.lifts != 1 || farthest > 9 * spread) { // the square of a smooth patch's spread is a quarter of its radius's
        for (int k = 0; k < 3; k++) lift(s, 0, k);
    } else if (farthest > spread) {
        lift(s, 0, axis);
    }
    s.lifts = 1;
}

// W' field, (contacts, 3).
void Multigrid::means(const MultigridState& s, const Column& field, double* out) const {
    for (int c = 0; c < s.contacts; c++)
        for (int a = 0; a < 3; a++) {
            double sum = 0;
            for (int k = 0; k < s.patch[c].count; k++) {
                const size_t at = 4 * size_t(s.patch[c].node[k]) + a;
                sum += s.patch[c].weight[k] * (field.wide ? field.wide[at] : double(field.narrow[at]));
            }
            out[3 * c + a] = sum;
        }
}

// The lever W'Z; false when two contacts cannot be told apart.
bool Multigrid::pull(MultigridState& s) const {
    const int m = 3 * s.contacts;
    double mean[3 * most_contacts];
    for (int c = 0; c < m; c++) {
        means(s, column(s.lift[c]), mean);
        for (int k = 0; k < m; k++) s.lever[k * m + c] = mean[k];
    }
    return factor(s.lever.data(), s.pivot.data(), m);
}

// u becomes the field of least energy, with W'u = d, in the span of the last ones and the lifts.
bool Multigrid::best_start(MultigridState& s, const double* displacement) const {
    constexpr int most = MultigridState::history + 3 * most_contacts;
    const int m = 3 * s.contacts;
    Column field[most], image[most];
    int count = 0;
    auto take = [&](const Column& f, const Column& g) { field[count] = f, image[count++] = g; };
    if (s.kept > 0) take(column(s.field[s.newest]), column(s.image[s.newest]));
    for (int c = 0; c < m; c++) take(column(s.lift[c]), column(s.image_lift[c]));
    for (int k = 1; k < s.kept; k++) {
        const int old = (s.newest + MultigridState::history - k) % MultigridState::history;
        take(column(s.field[old]), column(s.image[old]));
    }
    double *A = s.gram.data(), *X = s.small.data(), *C = X + size_t(count) * m, *coefficient = C + m * m;
    double* force = coefficient + count;
    gram(nodes(), count, field, image, s.scratch.data(), A);
    factor_independent(A, count, 1e-10);
    for (int i = 0; i < count; i++) { // X = L^-1 (W'V)'
        means(s, field[i], X + size_t(i) * m);
        for (int k = 0; k < i; k++)
            for (int c = 0; c < m; c++) X[i * m + c] -= A[i * count + k] * X[k * m + c];
        for (int c = 0; c < m; c++) X[i * m + c] = A[i * count + i] > 0 ? X[i * m + c] / A[i * count + i] : 0;
    }
    for (int a = 0; a < m; a++)
        for (int b = 0; b < m; b++) {
            C[a * m + b] = 0;
            for (int i = 0; i < count; i++) C[a * m + b] += X[i * m + a] * X[i * m + b];
        }
    double most_stiff = 0;
    for (int a = 0; a < m; a++) most_stiff = std::max(most_stiff, C[a * m + a]);
    factor_independent(C, m, 1e-9);
    for (int a = 0; a < m; a++)
        if (C[a * m + a] == 0) return false;
    std::copy_n(displacement, m, force); // force = (X'X)^-1 d: the least energy has y = X force
    for (int a = 0; a < m; a++) {
        for (int b = 0; b < a; b++) force[a] -= C[a * m + b] * force[b];
        force[a] /= C[a * m + a];
    }
    for (int a = m - 1; a >= 0; a--) {
        for (int b = a + 1; b < m; b++) force[a] -= C[b * m + a] * force[b];
        force[a] /= C[a * m + a];
    }
    for (int i = count - 1; i >= 0; i--) { // coefficient = L'^-1 y
        double y = 0;
        for (int c = 0; c < m; c++) y += X[i * m + c] * force[c];
        for (int k = i + 1; k < count; k++) y -= A[k * count + i] * coefficient[k];
        coefficient[i] = A[i * count + i] > 0 ? y / A[i * count + i] : 0;
    }
    double off[3 * most_contacts], mean[3 * most_contacts]; // what rounding leaves of W'u = d goes to the lifts
    std::copy_n(displacement, m, off);
    for (int i = 0; i < count; i++) {
        means(s, field[i], mean);
        for (int c = 0; c < m; c++) off[c] -= coefficient[i] * mean[c];
    }
    solve_factored(s.lever.data(), s.pivot.data(), m, off);
    for (int c = 0; c < m; c++) coefficient[(s.kept > 0 ? 1 : 0) + c] += off[c];
    const int oldest = s.kept == 0 ? 0 : (s.newest + 1) % MultigridState::history;
    combine(nodes(), count, field, coefficient, s.field[oldest].data());
    combine(nodes(), count, image, coefficient, s.image[oldest].data());
    s.newest = oldest;
    s.kept = std::min(s.kept + 1, MultigridState::history);
    return true;
}

void Multigrid::iterate(MultigridState& s, int iterations, bool exact) const {
    const int m = 3 * s.contacts, n = nodes();
    double *u = s.field[s.newest].data(), *Ku = s.image[s.newest].data();
    Column Z[3 * most_contacts], KZ[3 * most_contacts];
    double f[3 * most_contacts], c[3 * most_contacts];
    for (int k = 0; k < m; k++) Z[k] = column(s.lift[k]), KZ[k] = column(s.image_lift[k]);
    double curvature = 0;
    for (int it = 0; it < iterations; it++) {
        if (exact) refresh(s, 0, n);
        for (int k = 0; k < m; k++) f[k] = dot(n, s.lift[k].data(), Ku);
        solve_transposed(s.lever.data(), s.pivot.data(), m, f);
        to_narrow(n, -1, Ku, s.rhs.data());
        for (int a = 0; a < s.contacts; a++)
            for (int k = 0; k < s.patch[a].count; k++)
                for (int b = 0; b < 3; b++)
                    s.rhs[4 * size_t(s.patch[a].node[k]) + b] += float(s.patch[a].weight[k] * f[3 * a + b]);
        for (int i = 0; i < n; i++)
            if (held[i]) std::fill_n(&s.rhs[4 * size_t(i)], 4, 0.0f);
        cycle.apply(s.work, s.rhs.data(), s.z.data(), s.image_z.data());
        means(s, column(s.z), c);
        solve_factored(s.lever.data(), s.pivot.data(), m, c);
        double beta = 0, dots[2];
        if (it > 0 && curvature > 0) beta = -projected_dot(n, s.z.data(), m, Z, c, s.image_p.data()) / curvature;
        direction(n, s.z.data(), s.image_z.data(), m, Z, KZ, c, beta, s.p.data(), s.image_p.data(), Ku, dots);
        curvature = dots[0];
        if (!(curvature > 0)) return; // nothing left to gain
        const double alpha = -dots[1] / curvature;
        step(n, alpha, s.p.data(), u);
        step(n, alpha, s.image_p.data(), Ku);
    }
}

// The force on the tools: -f, f of the lifts' balance, and along the push such that its work is the energy, in which
// the error is squared.
void Multigrid::report(MultigridState& s, const double* displacement, double* force) const {
    const int m = 3 * s.contacts, n = nodes();
    const Field &u = s.field[s.newest], &Ku = s.image[s.newest];
    double f[3 * most_contacts], work = dot(n, u.data(), Ku.data()), square = 0;
    for (int k = 0; k < m; k++) f[k] = dot(n, s.lift[k].data(), Ku.data());
    solve_transposed(s.lever.data(), s.pivot.data(), m, f);
    for (int k = 0; k < m; k++) work -= f[k] * displacement[k], square += displacement[k] * displacement[k];
    for (int k = 0; k < m; k++) force[k] = -(f[k] + (square > 0 ? work / square * displacement[k] : 0));
    to_three(n, u.data(), s.u.data());
}

void Multigrid::refresh(MultigridState& s, int first, int last) const {
    rows_times(K.start.data(), K.column.data(), K.block.data(), first, last, s.field[s.newest].data(), 4,
               s.image[s.newest].data());
    for (int i = first; i < last; i++)
        if (held[i]) std::fill_n(&s.image[s.newest][4 * size_t(i)], 4, 0.0);
}

void Multigrid::advance(State& state, const Patch* patch, const double displacement[3], int sweeps,
                        double force[3]) const {
    auto& s = static_cast<MultigridState&>(state);
    force[0] = force[1] = force[2] = 0;
    if (!patch) return s.rest(); // nothing holds it: home is the equilibrium
    s.patch[0] = *patch;
    s.contacts = 1;
    keep_lifts(s);
    if (!pull(s) || !best_start(s, displacement)) {
        s.lifts = 0; // lifts that fit no longer
        keep_lifts(s);
        if (!pull(s) || !best_start(s, displacement)) return;
    }
    iterate(s, sweeps, false);
    const int some = (nodes() + refreshed - 1) / refreshed, first = std::min(s.next_row, nodes());
    refresh(s, first, std::min(first + some, nodes()));
    s.next_row = first + some >= nodes() ? 0 : first + some;
    report(s, displacement, force);
}

bool Multigrid::solve(State& state, const Patch* patches, int contacts, const double* displacement, int iterations,
                      double* force) const {
    auto& s = static_cast<MultigridState&>(state);
    if (contacts > most_contacts) return false;
    remember(s, std::max(contacts, 1));
    bool same = s.lifts == contacts && s.contacts == contacts;
    for (int c = 0; c < contacts && same; c++) {
        const Patch &a = s.patch[c], &b = patches[c];
        same = a.count == b.count && std::equal(a.node, a.node + a.count, b.node) &&
               std::equal(a.weight, a.weight + a.count, b.weight);
    }
    std::copy_n(patches, contacts, s.patch.begin());
    s.contacts = contacts;
    if (!same)
        for (int c = 0; c < contacts; c++)
            for (int k = 0; k < 3; k++) lift(s, c, k);
    s.lifts = contacts;
    from_three(nodes(), s.u.data(), s.field[s.newest].data());
    if (std::any_of(s.u.begin(), s.u.end(), [](double x) { return x != 0; })) {
        s.kept = std::max(s.kept, 1);
        refresh(s, 0, nodes());
    } else {
        s.kept = 0;
    }
    if (!pull(s) || !best_start(s, displacement)) {
        s.lifts = 0;
        return false;
    }
    iterate(s, iterations, true);
    report(s, displacement, force);
    return true;
}

void Multigrid::internal_force(const double* u, double* out) const {
    rows_times(K.start.data(), K.column.data(), K.block.data(), 0, nodes(), u, 3, out);
}

void Multigrid::precondition(const double* v, double* out) const {
    const size_t n = 4 * size_t(nodes());
    Field wide(n);
    Buffer rhs(n), x(n), product(n);
    CycleWork work = cycle.work();
    from_three(nodes(), v, wide.data());
    for (int i = 0; i < nodes(); i++)
        if (held[i]) std::fill_n(&wide[4 * size_t(i)], 4, 0.0);
    to_narrow(nodes(), 1, wide.data(), rhs.data());
    cycle.apply(work, rhs.data(), x.data(), product.data());
    for (int i = 0; i < nodes(); i++)
        for (int k = 0; k < 3; k++) out[3 * size_t(i) + k] = x[4 * size_t(i) + k];
}

} // namespace palpate
