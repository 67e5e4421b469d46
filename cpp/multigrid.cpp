#include "multigrid.h"
#include "dense.h"
#include "dispatch.h"
#include "multigrid_parts.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int refreshed = 64;   // ticks in which every row of K u is made anew
constexpr double nearly = 5e-3; // of the energy's root: gained in a tick by which the next has little to do

PALPATE_KERNEL void rows_times(const int* start, const int* column, const double* block, int first, int last,
                               const double* u, double* out) {
    for (int i = first; i < last; i++) {
        double sum[3] = {0, 0, 0};
        for (int k = start[i]; k < start[i + 1]; k++) {
            const double *b = block + 9 * size_t(k), *v = u + 4 * size_t(column[k]);
            for (int a = 0; a < 3; a++) sum[a] += b[3 * a] * v[0] + b[3 * a + 1] * v[1] + b[3 * a + 2] * v[2];
        }
        for (int a = 0; a < 3; a++) out[4 * size_t(i) + a] = sum[a];
    }
}

} // namespace

void MultigridState::rest() {
    State::rest();
    std::fill(now.begin(), now.end(), 0.0);
    std::fill(force.begin(), force.end(), 0.0);
    kept = contacts = lifts = next_row = 0;
    gained = 1;
}

Multigrid::Multigrid(const Elements& mesh, double cell, int sweeps, double relaxation)
    : Multigrid(Ordered(mesh), cell, sweeps, relaxation) {}

Multigrid::Multigrid(const Ordered& o, double cell, int sweeps, double relaxation)
    : order(o.order), inside(o.inside), K(stiffness(o.mesh)), held(o.held), place(o.node),
      cycle(K, o.mesh, cell, sweeps, relaxation) {}

std::unique_ptr<State> Multigrid::start() const {
    auto s = std::make_unique<MultigridState>();
    const size_t n = 4 * size_t(nodes());
    s->u.assign(3 * size_t(nodes()), 0);
    for (Field* f : {&s->now, &s->force, &s->gain, &s->run, &s->p, &s->image_p}) f->assign(n, 0);
    for (Buffer* b : {&s->rhs, &s->z, &s->image_z}) b->assign(n, 0);
    for (int k = 0; k < MultigridState::history; k++) s->change[k].assign(n, 0), s->force_change[k].assign(n, 0);
    s->work = cycle.work();
    remember(*s, most_tools);
    s->owner = this;
    return s;
}

// Room for so many contacts.
void Multigrid::remember(MultigridState& s, int contacts) const {
    const size_t m = 3 * size_t(contacts), before = s.lift.size();
    if (before >= m) return;
    for (size_t c = before; c < m; c++) {
        s.lift.emplace_back(4 * size_t(nodes()));
        s.image_lift.emplace_back(4 * size_t(nodes()));
    }
    s.patch.resize(contacts);
    s.lift_at.resize(3 * m);
    s.lever.resize(m * m);
    s.pivot.resize(m);
    const size_t span = s.span();
    s.gram.assign(span * span, 0);
    s.small.resize(span * span + span * m + m * m + span);
    s.kept = s.lifts = 0; // the span's numbers have moved
}

void Multigrid::touch(MultigridState& s, int contact, const Patch& patch) const {
    Patch& mine = s.patch[contact];
    mine.count = patch.count;
    for (int k = 0; k < patch.count; k++) mine.node[k] = inside[patch.node[k]], mine.weight[k] = patch.weight[k];
}

// The patches' forces, f spread by their weights, on top of the right-hand side.
void Multigrid::load(MultigridState& s, const double* f) const {
    for (int a = 0; a < s.contacts; a++)
        for (int k = 0; k < s.patch[a].count; k++)
            for (int b = 0; b < 3; b++)
                if (const int i = s.patch[a].node[k]; !held[i])
                    s.rhs[4 * size_t(i) + b] += float(s.patch[a].weight[k] * f[3 * a + b]);
}

// gain: what takes u to the start and then, by conjugate gradients, on from there; run: K (u + gain).
void Multigrid::iterate(MultigridState& s, const Start& start, int iterations, bool exact) const {
    const int m = 3 * s.contacts, n = nodes(), more = start.count - 1;
    const double* coefficient = start.coefficient;
    double f[most_columns];
    std::copy_n(start.f, m, f);
    combine(n, coefficient[0], s.force.data(), more, start.image + 1, coefficient + 1, s.run.data());
    combine(n, coefficient[0] - 1, s.now.data(), more, start.field + 1, coefficient + 1, s.gain.data());
    const float *Z[most_columns], *KZ[most_columns];
    double c[most_columns], product[2], out[1 + most_columns], curvature = 0;
    for (int k = 0; k < m; k++) Z[k] = s.lift[k].data(), KZ[k] = s.image_lift[k].data();
    for (int it = 0; it < iterations; it++) {
        if (exact) {
            s.whole = s.now;
            step(n, 1, s.gain.data(), s.whole.data());
            refresh(s.whole, s.run, 0, n);
        }
        if (exact || it > 0) {
            dots(n, {s.run.data(), nullptr}, s.gain.data(), m, Z, out);
            std::copy_n(out + 1, m, f);
            solve_transposed(s.lever.data(), s.pivot.data(), m, f);
        }
        to_narrow(n, -1, s.run.data(), s.rhs.data());
        load(s, f);
        cycle.apply(s.work, cycle.all(), s.rhs.data(), s.z.data(), s.image_z.data());
        means(s, column(s.z), c);
        solve_factored(s.lever.data(), s.pivot.data(), m, c);
        double beta = 0;
        if (it > 0) beta = -projected_dot(n, s.z.data(), m, Z, c, s.image_p.data()) / curvature;
        direction(n, s.z.data(), s.image_z.data(), m, Z, KZ, c, beta, s.p.data(), s.image_p.data(), s.run.data(),
                  product);
        curvature = product[0];
        if (!(curvature > 0)) return; // nothing left to gain
        const double alpha = -product[1] / curvature;
        step(n, alpha, s.p.data(), s.gain.data());
        if (it + 1 < iterations && !exact) step(n, alpha, s.image_p.data(), s.run.data());
    }
}

// `iterate` once and `keep`, with each field read as few times as can be. The direction p = z - Z c has W'p = 0 and the
// right-hand side no part along Z, so that all it takes are products with z.
void Multigrid::once(MultigridState& s, Start& start) const {
    constexpr int h = MultigridState::history;
    const int m = 3 * s.contacts, n = nodes(), more = start.count - 1, span = s.span();
    double *coefficient = start.coefficient, c[most_columns], out[2 + most_columns], less[most_span];
    for (int k = 0; k < start.count; k++) less[k] = -coefficient[k];
    combine(n, less[0], s.force.data(), more, start.image + 1, less + 1, s.rhs.data());
    load(s, start.f);
    cycle.apply(s.work, s.gained < nearly ? 1 : cycle.all(), s.rhs.data(), s.z.data(), s.image_z.data());
    means(s, column(s.z), c);
    solve_factored(s.lever.data(), s.pivot.data(), m, c);
    const float* with[2 + most_columns] = {s.image_z.data(), s.rhs.data()};
    for (int k = 0; k < m; k++) with[2 + k] = s.image_lift[k].data();
    dots(n, s.z.data(), 2 + m, with, out);
    double curvature = out[0];
    for (int a = 0; a < m; a++) {
        curvature -= 2 * c[a] * out[2 + a];
        for (int b = 0; b < m; b++) curvature += c[a] * c[b] * s.gram[(1 + h + a) * span + 1 + h + b];
    }
    const double alpha = curvature > 1e-6 * out[0] ? out[1] / curvature : 0; // else nothing is left to gain
    for (int a = 0; a < m; a++) coefficient[start.count - m + a] -= alpha * c[a];
    start.field[start.count] = s.z.data(), coefficient[start.count] = alpha;

    const int slot = (s.newest + 1) % h;
    float *change = s.change[slot].data(), *image = s.force_change[slot].data();
    take(n, coefficient[0] - 1, start.count, start.field + 1, coefficient + 1, order.data(), s.now.data(), change,
         s.u.data(), s.gain.data());
    multiply(cycle.fine(), change, image);
    s.newest = slot;
    s.kept = std::min(s.kept + 1, h);
    const float* fields[most_span];
    int which[most_span], count = 0;
    for (int k = 1; k < 1 + h + 3 * s.lifts; k++)
        if (present(s, k)) which[count] = k, fields[count++] = field(s, k);
    double of_image[1 + most_span], of_force[1 + most_span];
    add_and_dots(n, image, s.force.data(), s.now.data(), count, fields, of_image, of_force);
    refresh_some(s);
    auto note = [&](int a, int b, double value) { s.gram[a * span + b] = s.gram[b * span + a] = value; };
    for (int k = 0; k < count; k++) note(1 + slot, which[k], of_image[1 + k]);
    for (int k = 0; k < count; k++) note(0, which[k], of_force[1 + k]);
    note(0, 0, of_force[0]);
    s.gained = s.gram[0] > 0 ? std::sqrt(std::max(0.0, alpha * out[1]) / s.gram[0]) : 1;
}

// u takes what was gained; the gain is remembered, and K u gains its image.
void Multigrid::keep(MultigridState& s, bool exact) const {
    const int n = nodes(), slot = (s.newest + 1) % MultigridState::history;
    Buffer &change = s.change[slot], &image = s.force_change[slot];
    to_narrow(n, 1, s.gain.data(), change.data());
    multiply(cycle.fine(), change.data(), image.data());
    step(n, 1, s.gain.data(), s.now.data());
    if (exact) {
        refresh(s.now, s.force, 0, n);
    } else {
        step(n, 1, image.data(), s.force.data());
        refresh_some(s);
    }
    s.newest = slot;
    s.kept = std::min(s.kept + 1, MultigridState::history);
    products(s, 1 + slot);
    products(s, 0);
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) s.u[3 * size_t(order[i]) + k] = s.now[4 * size_t(i) + k];
}

// The force on the tools: -f, f of the lifts' balance, and along the push such that its work is the energy, in which
// the error is squared.
void Multigrid::report(MultigridState& s, const double* displacement, double* force) const {
    const int m = 3 * s.contacts;
    double f[most_columns], work = s.gram[0], square = 0;
    for (int k = 0; k < m; k++) f[k] = s.gram[1 + MultigridState::history + k];
    solve_transposed(s.lever.data(), s.pivot.data(), m, f);
    for (int k = 0; k < m; k++) work -= f[k] * displacement[k], square += displacement[k] * displacement[k];
    for (int k = 0; k < m; k++) force[k] = -(f[k] + (square > 0 ? work / square * displacement[k] : 0));
}

// Rows of the image, in float64; 0 where nodes are held.
void Multigrid::refresh(const Field& u, Field& image, int first, int last) const {
    rows_times(K.start.data(), K.column.data(), K.block.data(), first, last, u.data(), image.data());
    for (int i = first; i < last; i++)
        if (held[i]) std::fill_n(&image[4 * size_t(i)], 4, 0.0);
}

void Multigrid::refresh_some(MultigridState& s) const {
    const int n = nodes(), some = (n + refreshed - 1) / refreshed, first = std::min(s.next_row, n);
    refresh(s.now, s.force, first, std::min(first + some, n));
    s.next_row = first + some >= n ? 0 : first + some;
}

bool Multigrid::advance(State& state, const Patch* patches, int closed, int open, double* displacement, int sweeps,
                        double* force) const {
    auto& s = static_cast<MultigridState&>(state);
    const bool good = closed == 0 || hold(s, patches, closed, displacement, sweeps, force);
    if (closed == 0) s.rest(); // nothing holds it: home is the equilibrium
    feel(s, patches, closed, open, displacement, force);
    return good;
}

bool Multigrid::hold(MultigridState& s, const Patch* patches, int contacts, const double* displacement, int sweeps,
                     double* force) const {
    Start start;
    std::fill_n(force, 3 * contacts, 0.0);
    for (int c = 0; c < contacts; c++) touch(s, c, patches[c]);
    s.contacts = contacts;
    keep_lifts(s);
    if (!pull(s) || !best_start(s, displacement, start)) {
        s.lifts = 0; // lifts that fit no longer
        keep_lifts(s);
        if (!pull(s) || !best_start(s, displacement, start)) return false;
    }
    if (sweeps == 1) {
        once(s, start);
    } else {
        iterate(s, start, sweeps, false);
        keep(s, false);
        s.gained = 0;
    }
    report(s, displacement, force);
    return true;
}

bool Multigrid::solve(State& state, const Patch* patches, int contacts, const double* displacement, int iterations,
                      double* force) const {
    auto& s = static_cast<MultigridState&>(state);
    Start start;
    if (contacts < 1 || contacts > most_contacts) return false;
    remember(s, contacts);
    s.lifts = 0;
    for (int i = 0; i < nodes(); i++) // someone may have set u
        for (int k = 0; k < 3; k++) s.now[4 * size_t(i) + k] = s.u[3 * size_t(order[i]) + k];
    refresh(s.now, s.force, 0, nodes());
    products(s, 0);
    s.contacts = contacts;
    for (int c = 0; c < contacts; c++) touch(s, c, patches[c]);
    for (int c = 0; c < contacts; c++)
        for (int k = 0; k < 3; k++) lift(s, c, k);
    if (!pull(s) || !best_start(s, displacement, start)) {
        s.lifts = 0;
        return false;
    }
    iterate(s, start, iterations, true);
    keep(s, true);
    report(s, displacement, force);
    return true;
}

double Multigrid::moved() const {
    const HalfMatrix& half = cycle.fine();
    const double product = 4.0 * (half.block.size() + half.column.size() + half.diagonal.size());
    constexpr double narrow = 27, wide = 6.75; // of the five passes around the cycle
    return cycle.moved(1) + product + nodes() * (16 * narrow + 32 * wide);
}

void Multigrid::internal_force(const double* u, double* out) const {
    Field inner(4 * size_t(nodes())), image(inner.size());
    for (int i = 0; i < nodes(); i++)
        for (int k = 0; k < 3; k++) inner[4 * size_t(i) + k] = u[3 * size_t(order[i]) + k];
    rows_times(K.start.data(), K.column.data(), K.block.data(), 0, nodes(), inner.data(), image.data());
    for (int i = 0; i < nodes(); i++)
        for (int k = 0; k < 3; k++) out[3 * size_t(order[i]) + k] = image[4 * size_t(i) + k];
}

void Multigrid::precondition(const double* v, double* out) const {
    const size_t n = 4 * size_t(nodes());
    Buffer rhs(n), x(n), product(n);
    CycleWork work = cycle.work();
    for (int i = 0; i < nodes(); i++)
        for (int k = 0; k < 3; k++) rhs[4 * size_t(i) + k] = held[i] ? 0 : float(v[3 * size_t(order[i]) + k]);
    cycle.apply(work, cycle.all(), rhs.data(), x.data(), product.data());
    for (int i = 0; i < nodes(); i++)
        for (int k = 0; k < 3; k++) out[3 * size_t(order[i]) + k] = x[4 * size_t(i) + k];
}

} // namespace palpate
