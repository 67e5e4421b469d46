#include "dense.h"
#include "multigrid_parts.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double independent = 1e-10; // part of a field's energy below which it says nothing new

void centre(const Patch& patch, const double* place, double at[3], double& spread) {
    at[0] = at[1] = at[2] = spread = 0;
    for (int k = 0; k < patch.count; k++)
        for (int a = 0; a < 3; a++) at[a] += patch.weight[k] * place[3 * size_t(patch.node[k]) + a];
    for (int k = 0; k < patch.count; k++)
        for (int a = 0; a < 3; a++) {
            const double away = place[3 * size_t(patch.node[k]) + a] - at[a];
            spread += patch.weight[k] * away * away;
        }
}

} // namespace

// The span: slot 0 is u, then the changes, then the lifts.
const float* Multigrid::field(const MultigridState& s, int slot) const {
    constexpr int h = MultigridState::history;
    return slot <= h ? s.change[slot - 1].data() : s.lift[slot - 1 - h].data();
}

const float* Multigrid::image(const MultigridState& s, int slot) const {
    constexpr int h = MultigridState::history;
    return slot <= h ? s.force_change[slot - 1].data() : s.image_lift[slot - 1 - h].data();
}

bool Multigrid::present(const MultigridState& s, int slot) const {
    constexpr int h = MultigridState::history;
    if (slot == 0 || slot > h) return slot <= h + 3 * s.lifts;
    const int age = (s.newest - (slot - 1) + h) % h;
    return age < s.kept;
}

// A row and column of the span's V'KV. K u is kept in float64, other images in float32: where both would do, the
// former.
void Multigrid::products(MultigridState& s, int slot) const {
    const int span = s.span();
    const float* with[most_span];
    int which[most_span], count = 0;
    for (int other = 1; other < span; other++)
        if (present(s, other) || other == slot) which[count] = other, with[count++] = field(s, other);
    double out[1 + most_span];
    auto note = [&](int a, int b, double value) { s.gram[a * span + b] = s.gram[b * span + a] = value; };
    if (slot > 0) {
        dots(nodes(), {nullptr, image(s, slot)}, s.now.data(), count, with, out);
        for (int k = 0; k < count; k++) note(slot, which[k], out[1 + k]);
        const float* own = field(s, slot);
        dots(nodes(), {s.force.data(), nullptr}, s.now.data(), 1, &own, out);
        note(0, slot, out[1]);
        return;
    }
    if (count == 0) which[0] = 1, with[count++] = field(s, 1); // what is not present yet will be noted anew
    dots(nodes(), {s.force.data(), nullptr}, s.now.data(), count, with, out);
    note(0, 0, out[0]);
    for (int k = 0; k < count; k++) note(0, which[k], out[1 + k]);
}

// Z and K Z of one contact along one axis.
void Multigrid::lift(MultigridState& s, int contact, int axis) const {
    const Patch& patch = s.patch[contact];
    const int c = 3 * contact + axis;
    std::fill(s.rhs.begin(), s.rhs.end(), 0.0f);
    for (int k = 0; k < patch.count; k++)
        if (!held[patch.node[k]]) s.rhs[4 * size_t(patch.node[k]) + axis] = float(patch.weight[k]);
    cycle.apply_coarse(s.work, s.rhs.data(), s.lift[c].data());
    multiply(cycle.fine(), s.lift[c].data(), s.image_lift[c].data());
    double spread;
    centre(patch, place.data(), &s.lift_at[3 * size_t(c)], spread);
    s.lifts = std::max(s.lifts, contact + 1);
    products(s, 1 + MultigridState::history + c);
}

// In a loop: a contact's lifts where it lands, then the one left farthest behind once it is half a radius off.
void Multigrid::keep_lifts(MultigridState& s) const {
    s.lifts = std::min(s.lifts, s.contacts);
    for (int c = 0; c < s.contacts; c++) {
        double at[3], spread, farthest = -1;
        int axis = 0;
        centre(s.patch[c], place.data(), at, spread);
        for (int k = 0; k < 3 && c < s.lifts; k++) {
            const double* was = &s.lift_at[9 * size_t(c) + 3 * k];
            double away = 0;
            for (int a = 0; a < 3; a++) away += (at[a] - was[a]) * (at[a] - was[a]);
            if (away > farthest) farthest = away, axis = k;
        }
        if (c >= s.lifts || farthest > 9 * spread) // the square of a smooth patch's spread: a quarter of its radius's
            for (int k = 0; k < 3; k++) lift(s, c, k);
        else if (farthest > spread)
            lift(s, c, axis);
    }
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
    double mean[most_columns];
    for (int c = 0; c < m; c++) {
        means(s, column(s.lift[c]), mean);
        for (int k = 0; k < m; k++) s.lever[k * m + c] = mean[k];
    }
    return factor(s.lever.data(), s.pivot.data(), m);
}

// start: the field of least energy, with W'u = d, in the span, and the multiplier f that leaves its K u - W f without
// a part along Z.
bool Multigrid::best_start(MultigridState& s, const double* displacement, Start& start) const {
    constexpr int h = MultigridState::history;
    const int m = 3 * s.contacts, span = s.span();
    const float** fields = start.field;
    int *slot = start.slot, &count = start.count;
    double *coefficient = start.coefficient, *f = start.f;
    slot[0] = 0, count = 1;
    for (int k = 1; k < 1 + h + m; k++)
        if (present(s, k)) slot[count] = k, fields[count] = field(s, k), start.image[count++] = image(s, k);
    auto mean_of = [&](int i, double* out) { means(s, i == 0 ? column(s.now) : Column{nullptr, fields[i]}, out); };
    double *A = s.small.data(), *X = A + count * count, *C = X + count * m;
    double force[most_columns], mean[most_columns];
    for (int a = 0; a < count; a++)
        for (int b = 0; b < count; b++) A[a * count + b] = s.gram[slot[a] * span + slot[b]];
    factor_independent(A, count, independent);
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
    double off[most_columns]; // what rounding leaves of W'u = d goes to the lifts
    std::copy_n(displacement, m, off);
    for (int i = 0; i < count; i++) {
        mean_of(i, mean);
        for (int c = 0; c < m; c++) off[c] -= coefficient[i] * mean[c];
    }
    solve_factored(s.lever.data(), s.pivot.data(), m, off);
    for (int c = 0; c < m; c++) coefficient[count - m + c] += off[c];
    for (int c = 0; c < m; c++) {
        f[c] = 0;
        for (int i = 0; i < count; i++) f[c] += s.gram[(1 + h + c) * span + slot[i]] * coefficient[i];
    }
    solve_transposed(s.lever.data(), s.pivot.data(), m, f);
    return true;
}

} // namespace palpate
