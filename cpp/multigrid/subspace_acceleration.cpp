#include "base/vec3.h"
#include "linalg/small_dense.h"
#include "multigrid/multigrid_model.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double independence = 1e-10; // part of a field's energy below which it counts as linearly dependent

// The weighted mean position of a patch, and its mean squared distance from there.
void centre_and_spread(const ContactPatch& patch, const double* position, double at[3], double& spread) {
    spread = 0;
    patch.mean(position, at);
    for (int k = 0; k < patch.count; k++)
        for (int a = 0; a < 3; a++) {
            const double offset = position[3 * size_t(patch.node[k]) + a] - at[a];
            spread += patch.weight[k] * offset * offset;
        }
}

} // namespace

// Initial guesses of MultigridModel from the span V of earlier fields: slot 0 is u, then the changes, then the lifts.
const float* MultigridModel::span_field(const MultigridState& s, int slot) const {
    constexpr int h = MultigridState::history;
    return slot <= h ? s.change[slot - 1].data() : s.lift[slot - 1 - h].data();
}

const float* MultigridModel::span_image(const MultigridState& s, int slot) const {
    constexpr int h = MultigridState::history;
    return slot <= h ? s.K_change[slot - 1].data() : s.K_lift[slot - 1 - h].data();
}

bool MultigridModel::in_span(const MultigridState& s, int slot) const {
    constexpr int h = MultigridState::history;
    if (slot == 0 || slot > h) return slot <= h + 3 * s.lifted_contacts;
    const int age = (s.newest_change - (slot - 1) + h) % h;
    return age < s.changes_kept;
}

// Recomputes a row and a column of V'KV. K u is in float64 and the other images in float32, so products with u use K u.
void MultigridModel::update_gram(MultigridState& s, int slot) const {
    const int span = s.span();
    const float* with[most_span];
    int which[most_span], count = 0;
    for (int other = 1; other < span; other++)
        if (in_span(s, other) || other == slot) which[count] = other, with[count++] = span_field(s, other);
    double out[1 + most_span];
    auto set = [&](int a, int b, double value) { s.gram[a * span + b] = s.gram[b * span + a] = value; };
    if (slot > 0) {
        dots(nodes(), span_image(s, slot), s.solution.data(), count, with, out);
        for (int k = 0; k < count; k++) set(slot, which[k], out[1 + k]);
        const float* own = span_field(s, slot);
        dots(nodes(), s.Ku, s.solution.data(), 1, &own, out);
        set(0, slot, out[1]);
        return;
    }
    if (count == 0)
        which[0] = 1, with[count++] = span_field(s, 1); // any field: its entry is recomputed before it is used
    dots(nodes(), s.Ku, s.solution.data(), count, with, out);
    set(0, 0, out[0]);
    for (int k = 0; k < count; k++) set(0, which[k], out[1 + k]);
}

// Computes Z and K Z of one contact along one axis.
void MultigridModel::compute_lift(MultigridState& s, int contact, int axis) const {
    const ContactPatch& patch = s.patch[contact];
    const int c = 3 * contact + axis;
    std::fill(s.rhs.begin(), s.rhs.end(), 0.0f);
    for (int k = 0; k < patch.count; k++)
        if (!fixed[patch.node[k]]) s.rhs[4 * size_t(patch.node[k]) + axis] = float(patch.weight[k]);
    cycle.apply_coarse(s.work, s.rhs.data(), s.lift[c].data());
    multiply(cycle.fine(), s.lift[c].data(), s.K_lift[c].data());
    double spread;
    centre_and_spread(patch, position.data(), &s.lift_position[3 * size_t(c)], spread);
    s.lifted_contacts = std::max(s.lifted_contacts, contact + 1);
    update_gram(s, 1 + MultigridState::history + c);
}

// A new contact gets its three lifts. Later the lift that is farthest behind is recomputed once the contact has moved
// by half a radius.
void MultigridModel::update_lifts(MultigridState& s) const {
    s.lifted_contacts = std::min(s.lifted_contacts, s.contacts);
    for (int c = 0; c < s.contacts; c++) {
        double at[3], spread, farthest = -1;
        int axis = 0;
        centre_and_spread(s.patch[c], position.data(), at, spread);
        for (int k = 0; k < 3 && c < s.lifted_contacts; k++) {
            const double square = square_of_distance(at, &s.lift_position[9 * size_t(c) + 3 * k]);
            if (square > farthest) farthest = square, axis = k;
        }
        if (c >= s.lifted_contacts || farthest > 9 * spread) // the spread is about (radius / 2)^2
            for (int k = 0; k < 3; k++) compute_lift(s, c, k);
        else if (farthest > spread)
            compute_lift(s, c, axis);
    }
}

// out = W' field, (contacts, 3).
void MultigridModel::patch_means(const MultigridState& s, const FieldView& field, double* out) const {
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

// Factors W'Z; false if the contacts are linearly dependent.
bool MultigridModel::factor_lift_means(MultigridState& s) const {
    const int m = 3 * s.contacts;
    double mean[most_columns];
    for (int c = 0; c < m; c++) {
        patch_means(s, s.lift[c], mean);
        for (int k = 0; k < m; k++) s.lift_means[k * m + c] = mean[k];
    }
    return factor(s.lift_means.data(), s.pivot.data(), m);
}

// The field of least energy in the span with W'u = d, and the multiplier f for which K u - W f is orthogonal to Z.
bool MultigridModel::initial_guess(MultigridState& s, const double* displacement, InitialGuess& guess) const {
    constexpr int h = MultigridState::history;
    const int m = 3 * s.contacts, span = s.span();
    const float** fields = guess.field;
    int *slot = guess.slot, &count = guess.count;
    double *coefficient = guess.coefficient, *f = guess.f;
    slot[0] = 0, count = 1;
    for (int k = 1; k < 1 + h + m; k++)
        if (in_span(s, k)) slot[count] = k, fields[count] = span_field(s, k), guess.image[count++] = span_image(s, k);
    auto mean_of = [&](int i, double* out) {
        patch_means(s, i == 0 ? FieldView(s.solution) : FieldView(fields[i]), out);
    };
    double *A = s.scratch.data(), *X = A + count * count, *C = X + count * m;
    double force[most_columns], mean[most_columns];
    for (int a = 0; a < count; a++)
        for (int b = 0; b < count; b++) A[a * count + b] = s.gram[slot[a] * span + slot[b]];
    factor_independent(A, count, independence);
    for (int i = 0; i < count; i++) { // X = L^-1 (W'V)'
        mean_of(i, X + i * m);
        for (int k = 0; k < i; k++)
            for (int c = 0; c < m; c++) X[i * m + c] -= A[i * count + k] * X[k * m + c];
        for (int c = 0; c < m; c++) X[i * m + c] = A[i * count + i] > 0 ? X[i * m + c] / A[i * count + i] : 0;
    }
    std::fill_n(C, m * m, 0.0);
    for (int i = 0; i < count; i++)
        for (int a = 0; a < m; a++)
            for (int b = 0; b <= a; b++) C[a * m + b] += X[i * m + a] * X[i * m + b];
    factor_independent(C, m, 1e-9);
    for (int a = 0; a < m; a++)
        if (C[a * m + a] == 0) return false;
    std::copy_n(displacement, m, force);
    solve_positive(C, m, force);           // force = (X'X)^-1 d: the least energy has y = X force
    for (int i = count - 1; i >= 0; i--) { // coefficient = L'^-1 y
        double y = 0;
        for (int c = 0; c < m; c++) y += X[i * m + c] * force[c];
        for (int k = i + 1; k < count; k++) y -= A[k * count + i] * coefficient[k];
        coefficient[i] = A[i * count + i] > 0 ? y / A[i * count + i] : 0;
    }
    double error[most_columns]; // the lifts correct the rounding error of W'u = d
    std::copy_n(displacement, m, error);
    for (int i = 0; i < count; i++) {
        mean_of(i, mean);
        for (int c = 0; c < m; c++) error[c] -= coefficient[i] * mean[c];
    }
    solve_factored(s.lift_means.data(), s.pivot.data(), m, error);
    for (int c = 0; c < m; c++) coefficient[count - m + c] += error[c];
    for (int c = 0; c < m; c++) {
        f[c] = 0;
        for (int i = 0; i < count; i++) f[c] += s.gram[(1 + h + c) * span + slot[i]] * coefficient[i];
    }
    solve_transposed(s.lift_means.data(), s.pivot.data(), m, f);
    return true;
}

} // namespace palpate
