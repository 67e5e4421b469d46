#include "multigrid/multigrid_model.h"
#include "linalg/small_dense.h"
#include "multigrid/graph_coloring.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int refresh_period = 64;  // ticks in which every row of K u is recomputed
constexpr double small_gain = 5e-3; // MultigridState::last_gain below which one fine sweep is enough

} // namespace

void MultigridState::reset() {
    ModelState::reset();
    std::fill(solution.begin(), solution.end(), 0.0);
    std::fill(Ku.begin(), Ku.end(), 0.0);
    changes_kept = contacts = lifted_contacts = next_row = 0;
    last_gain = 1;
}

MultigridModel::MultigridModel(const ElasticMesh& mesh, double cell, int sweeps, double relaxation)
    : MultigridModel(ColoredMesh(mesh), cell, sweeps, relaxation) {}

MultigridModel::MultigridModel(const ColoredMesh& o, double cell, int sweeps, double relaxation)
    : order(o.order), internal_index(o.internal_index), K(assemble_stiffness(o.mesh)), fixed(o.fixed), position(o.node),
      cycle(K, o.mesh, cell, sweeps, relaxation) {}

std::unique_ptr<ModelState> MultigridModel::make_state() const {
    auto s = std::make_unique<MultigridState>();
    const size_t n = 4 * size_t(nodes());
    s->u.assign(3 * size_t(nodes()), 0);
    for (Field* f : {&s->solution, &s->Ku, &s->increment, &s->new_Ku, &s->p, &s->Kp}) f->assign(n, 0);
    for (AlignedBuffer* b : {&s->rhs, &s->z, &s->Kz}) b->assign(n, 0);
    for (int k = 0; k < MultigridState::history; k++) s->change[k].assign(n, 0), s->K_change[k].assign(n, 0);
    s->work = cycle.make_workspace();
    reserve_contacts(*s, TissueModel::max_patches);
    s->owner = this;
    return s;
}

// Allocates for so many contacts.
void MultigridModel::reserve_contacts(MultigridState& s, int contacts) const {
    const size_t m = 3 * size_t(contacts), before = s.lift.size();
    if (before >= m) return;
    for (size_t c = before; c < m; c++) {
        s.lift.emplace_back(4 * size_t(nodes()));
        s.K_lift.emplace_back(4 * size_t(nodes()));
    }
    s.patch.resize(contacts);
    s.lift_position.resize(3 * m);
    s.lift_means.resize(m * m);
    s.pivot.resize(m);
    const size_t span = s.span();
    s.gram.assign(span * span, 0);
    s.scratch.resize(span * span + span * m + m * m + span);
    s.changes_kept = s.lifted_contacts = 0; // the slots of the span have changed
}

void MultigridModel::set_patch(MultigridState& s, int contact, const ContactPatch& patch) const {
    ContactPatch& own = s.patch[contact];
    own.count = patch.count;
    for (int k = 0; k < patch.count; k++) own.node[k] = internal_index[patch.node[k]], own.weight[k] = patch.weight[k];
}

// rhs += W f at the free nodes.
void MultigridModel::add_patch_forces(MultigridState& s, const double* f) const {
    for (int a = 0; a < s.contacts; a++)
        for (int k = 0; k < s.patch[a].count; k++)
            for (int b = 0; b < 3; b++)
                if (const int i = s.patch[a].node[k]; !fixed[i])
                    s.rhs[4 * size_t(i) + b] += float(s.patch[a].weight[k] * f[3 * a + b]);
}

// increment: from u to the initial guess, and on by conjugate gradients. new_Ku = K (u + increment).
void MultigridModel::conjugate_gradients(MultigridState& s, const InitialGuess& guess, int iterations,
                                         bool exact) const {
    const int m = 3 * s.contacts, n = nodes(), rest = guess.count - 1;
    const double* coefficient = guess.coefficient;
    double f[most_columns];
    std::copy_n(guess.f, m, f);
    combine(n, coefficient[0], s.Ku.data(), rest, guess.image + 1, coefficient + 1, s.new_Ku.data());
    combine(n, coefficient[0] - 1, s.solution.data(), rest, guess.field + 1, coefficient + 1, s.increment.data());
    const float *Z[most_columns], *KZ[most_columns];
    double c[most_columns], product[2], out[1 + most_columns], curvature = 0;
    for (int k = 0; k < m; k++) Z[k] = s.lift[k].data(), KZ[k] = s.K_lift[k].data();
    for (int it = 0; it < iterations; it++) {
        if (exact) {
            s.new_solution = s.solution;
            add_scaled(n, 1, s.increment.data(), s.new_solution.data());
            refresh_rows(s.new_solution, s.new_Ku, 0, n);
        }
        if (exact || it > 0) {
            dots(n, s.new_Ku, s.increment.data(), m, Z, out);
            std::copy_n(out + 1, m, f);
            solve_transposed(s.lift_means.data(), s.pivot.data(), m, f);
        }
        round_scaled(n, -1, s.new_Ku.data(), s.rhs.data());
        add_patch_forces(s, f);
        cycle.apply(s.work, cycle.sweep_count(), s.rhs.data(), s.z.data(), s.Kz.data());
        patch_means(s, s.z, c);
        solve_factored(s.lift_means.data(), s.pivot.data(), m, c);
        double beta = 0;
        if (it > 0) beta = -projected_dot(n, s.z.data(), m, Z, c, s.Kp.data()) / curvature;
        update_direction(n, s.z.data(), s.Kz.data(), m, Z, KZ, c, beta, s.p.data(), s.Kp.data(), s.new_Ku.data(),
                         product);
        curvature = product[0];
        if (!(curvature > 0)) return; // converged
        const double alpha = -product[1] / curvature;
        add_scaled(n, alpha, s.p.data(), s.increment.data());
        if (it + 1 < iterations && !exact) add_scaled(n, alpha, s.Kp.data(), s.new_Ku.data());
    }
}

// The same as conjugate_gradients() with one iteration and accept_increment(), but reads each field as rarely as
// possible. The direction p = z - Z c has W'p = 0 and the right-hand side is orthogonal to Z, so products with z are
// sufficient.
void MultigridModel::single_iteration(MultigridState& s, InitialGuess& guess) const {
    constexpr int h = MultigridState::history;
    const int m = 3 * s.contacts, n = nodes(), rest = guess.count - 1, span = s.span();
    double *coefficient = guess.coefficient, c[most_columns], out[2 + most_columns], negated[most_span];
    for (int k = 0; k < guess.count; k++) negated[k] = -coefficient[k];
    combine(n, negated[0], s.Ku.data(), rest, guess.image + 1, negated + 1, s.rhs.data());
    add_patch_forces(s, guess.f);
    cycle.apply(s.work, s.last_gain < small_gain ? 1 : cycle.sweep_count(), s.rhs.data(), s.z.data(), s.Kz.data());
    patch_means(s, s.z, c);
    solve_factored(s.lift_means.data(), s.pivot.data(), m, c);
    const float* with[2 + most_columns] = {s.Kz.data(), s.rhs.data()};
    for (int k = 0; k < m; k++) with[2 + k] = s.K_lift[k].data();
    dots(n, s.z, nullptr, 2 + m, with, out);
    double curvature = out[0];
    for (int a = 0; a < m; a++) {
        curvature -= 2 * c[a] * out[2 + a];
        for (int b = 0; b < m; b++) curvature += c[a] * c[b] * s.gram[(1 + h + a) * span + 1 + h + b];
    }
    const double alpha = curvature > 1e-6 * out[0] ? out[1] / curvature : 0; // else converged
    for (int a = 0; a < m; a++) coefficient[guess.count - m + a] -= alpha * c[a];
    guess.field[guess.count] = s.z.data(), coefficient[guess.count] = alpha;

    const int slot = (s.newest_change + 1) % h;
    float *change = s.change[slot].data(), *image = s.K_change[slot].data();
    add_combination(n, coefficient[0] - 1, guess.count, guess.field + 1, coefficient + 1, order.data(),
                    s.solution.data(), change, s.u.data(), s.increment.data());
    multiply(cycle.fine(), change, image);
    s.newest_change = slot;
    s.changes_kept = std::min(s.changes_kept + 1, h);
    const float* fields[most_span];
    int which[most_span], count = 0;
    for (int k = 1; k < 1 + h + 3 * s.lifted_contacts; k++)
        if (in_span(s, k)) which[count] = k, fields[count++] = span_field(s, k);
    double of_image[1 + most_span], of_force[1 + most_span];
    add_and_dots(n, image, s.Ku.data(), s.solution.data(), count, fields, of_image, of_force);
    refresh_next_rows(s);
    auto set = [&](int a, int b, double value) { s.gram[a * span + b] = s.gram[b * span + a] = value; };
    for (int k = 0; k < count; k++) set(1 + slot, which[k], of_image[1 + k]);
    for (int k = 0; k < count; k++) set(0, which[k], of_force[1 + k]);
    set(0, 0, of_force[0]);
    s.last_gain = s.gram[0] > 0 ? std::sqrt(std::max(0.0, alpha * out[1]) / s.gram[0]) : 1;
}

// u += increment, K u += its image; the increment joins the span.
void MultigridModel::accept_increment(MultigridState& s, bool exact) const {
    const int n = nodes(), slot = (s.newest_change + 1) % MultigridState::history;
    AlignedBuffer &change = s.change[slot], &image = s.K_change[slot];
    round_scaled(n, 1, s.increment.data(), change.data());
    multiply(cycle.fine(), change.data(), image.data());
    add_scaled(n, 1, s.increment.data(), s.solution.data());
    if (exact) {
        refresh_rows(s.solution, s.Ku, 0, n);
    } else {
        add_scaled(n, 1, image.data(), s.Ku.data());
        refresh_next_rows(s);
    }
    s.newest_change = slot;
    s.changes_kept = std::min(s.changes_kept + 1, MultigridState::history);
    update_gram(s, 1 + slot);
    update_gram(s, 0);
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) s.u[3 * size_t(order[i]) + k] = s.solution[4 * size_t(i) + k];
}

// The force on the tools: -f, with f from the equilibrium of the lifts, corrected along the displacement so that its
// work equals the energy, whose error is of second order.
void MultigridModel::tool_forces(MultigridState& s, const double* displacement, double* force) const {
    const int m = 3 * s.contacts;
    double f[most_columns], work = s.gram[0], square = 0;
    for (int k = 0; k < m; k++) f[k] = s.gram[1 + MultigridState::history + k];
    solve_transposed(s.lift_means.data(), s.pivot.data(), m, f);
    for (int k = 0; k < m; k++) work -= f[k] * displacement[k], square += displacement[k] * displacement[k];
    for (int k = 0; k < m; k++) force[k] = -(f[k] + (square > 0 ? work / square * displacement[k] : 0));
}

// Rows of image = K u in float64; 0 at fixed nodes.
void MultigridModel::refresh_rows(const Field& u, Field& image, int first, int last) const {
    multiply_rows(K, first, last, u.data(), image.data());
    for (int i = first; i < last; i++)
        if (fixed[i]) std::fill_n(&image[4 * size_t(i)], 4, 0.0);
}

void MultigridModel::refresh_next_rows(MultigridState& s) const {
    const int n = nodes(), some = (n + refresh_period - 1) / refresh_period, first = std::min(s.next_row, n);
    refresh_rows(s.solution, s.Ku, first, std::min(first + some, n));
    s.next_row = first + some >= n ? 0 : first + some;
}

bool MultigridModel::relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed,
                           double* displacement, int sweeps, double* force) const {
    auto& s = static_cast<MultigridState&>(state);
    const bool good = prescribed == 0 || solve_tick(s, patches, prescribed, displacement, sweeps, force);
    if (prescribed == 0) s.reset(); // no contact: the equilibrium is at rest
    observe_patches(s, patches, prescribed, observed, displacement, force);
    return good;
}

bool MultigridModel::solve_tick(MultigridState& s, const ContactPatch* patches, int contacts,
                                const double* displacement, int sweeps, double* force) const {
    InitialGuess guess;
    std::fill_n(force, 3 * contacts, 0.0);
    for (int c = 0; c < contacts; c++) set_patch(s, c, patches[c]);
    s.contacts = contacts;
    update_lifts(s);
    if (!factor_lift_means(s) || !initial_guess(s, displacement, guess)) {
        s.lifted_contacts = 0; // the lifts no longer fit the patches
        update_lifts(s);
        if (!factor_lift_means(s) || !initial_guess(s, displacement, guess)) return false;
    }
    if (sweeps == 1) {
        single_iteration(s, guess);
    } else {
        conjugate_gradients(s, guess, sweeps, false);
        accept_increment(s, false);
        s.last_gain = 0;
    }
    tool_forces(s, displacement, force);
    return true;
}

bool MultigridModel::solve(ModelState& state, const ContactPatch* patches, int contacts, const double* displacement,
                           int iterations, double* force) const {
    auto& s = static_cast<MultigridState&>(state);
    InitialGuess guess;
    if (contacts < 1 || contacts > most_contacts) return false;
    reserve_contacts(s, contacts);
    s.lifted_contacts = 0;
    for (int i = 0; i < nodes(); i++) // a caller may have set u
        for (int k = 0; k < 3; k++) s.solution[4 * size_t(i) + k] = s.u[3 * size_t(order[i]) + k];
    refresh_rows(s.solution, s.Ku, 0, nodes());
    update_gram(s, 0);
    s.contacts = contacts;
    for (int c = 0; c < contacts; c++) set_patch(s, c, patches[c]);
    for (int c = 0; c < contacts; c++)
        for (int k = 0; k < 3; k++) compute_lift(s, c, k);
    if (!factor_lift_means(s) || !initial_guess(s, displacement, guess)) {
        s.lifted_contacts = 0;
        return false;
    }
    conjugate_gradients(s, guess, iterations, true);
    accept_increment(s, true);
    tool_forces(s, displacement, force);
    return true;
}

double MultigridModel::bytes_per_tick() const {
    const HalfBlockCsr& half = cycle.fine();
    const double product = 4.0 * (half.block.size() + half.column.size() + half.diagonal.size());
    constexpr double narrow = 27, wide = 6.75; // fields of the five passes around the V-cycle
    return cycle.bytes_moved(1) + product + nodes() * (16 * narrow + 32 * wide);
}

void MultigridModel::internal_force(const double* u, double* out) const {
    Field inner(4 * size_t(nodes())), image(inner.size());
    for (int i = 0; i < nodes(); i++)
        for (int k = 0; k < 3; k++) inner[4 * size_t(i) + k] = u[3 * size_t(order[i]) + k];
    multiply_rows(K, 0, nodes(), inner.data(), image.data());
    for (int i = 0; i < nodes(); i++)
        for (int k = 0; k < 3; k++) out[3 * size_t(order[i]) + k] = image[4 * size_t(i) + k];
}

void MultigridModel::precondition(const double* v, double* out) const {
    const size_t n = 4 * size_t(nodes());
    AlignedBuffer rhs(n), x(n), product(n);
    VCycleWorkspace work = cycle.make_workspace();
    for (int i = 0; i < nodes(); i++)
        for (int k = 0; k < 3; k++) rhs[4 * size_t(i) + k] = fixed[i] ? 0 : float(v[3 * size_t(order[i]) + k]);
    cycle.apply(work, cycle.sweep_count(), rhs.data(), x.data(), product.data());
    for (int i = 0; i < nodes(); i++)
        for (int k = 0; k < 3; k++) out[3 * size_t(order[i]) + k] = x[4 * size_t(i) + k];
}

} // namespace palpate
