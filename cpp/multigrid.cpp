#include "multigrid.h"
#include "dense.h"
#include "dispatch.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int refreshed = 64;         // ticks in which every row of K u is made anew
constexpr double independent = 1e-10; // part of a field's energy below which it says nothing new
constexpr int most_columns = 3 * Multigrid::most_contacts;
constexpr double nearly = 5e-3; // of the energy's root: gained in a tick by which the next has little to do
constexpr int most_span = 1 + MultigridState::history + most_columns;

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

// By colours, no two neighbours of one: the first colour that a node's neighbours before it have left. Of one colour,
// those with as many neighbours of earlier colours stand together, so that the sweeps' branches are foreseen.
std::vector<int> by_colour(const Elements& mesh) {
    std::vector<std::vector<int>> tets(mesh.nodes);
    for (int t = 0; t < mesh.tets; t++)
        for (int k = 0; k < 4; k++) tets[mesh.tet[4 * size_t(t) + k]].push_back(t);
    std::vector<int> colour(mesh.nodes, -1), order(mesh.nodes);
    std::vector<uint8_t> taken;
    for (int i = 0; i < mesh.nodes; i++) {
        taken.assign(taken.size() + 1, 0);
        for (int t : tets[i])
            for (int k = 0; k < 4; k++)
                if (const int c = colour[mesh.tet[4 * size_t(t) + k]]; c >= 0) {
                    if (size_t(c) >= taken.size()) taken.resize(c + 1, 0);
                    taken[c] = 1;
                }
        colour[i] = int(std::find(taken.begin(), taken.end(), 0) - taken.begin());
        taken.resize(std::min<size_t>(taken.size(), 64));
    }
    std::vector<int> before(mesh.nodes), near;
    for (int i = 0; i < mesh.nodes; i++) {
        near.clear();
        for (int t : tets[i])
            for (int k = 0; k < 4; k++)
                if (const int j = mesh.tet[4 * size_t(t) + k]; colour[j] < colour[i] && !mesh.held[j])
                    near.push_back(j);
        std::sort(near.begin(), near.end());
        before[i] = mesh.held[i] ? 0 : int(std::unique(near.begin(), near.end()) - near.begin());
    }
    for (int i = 0; i < mesh.nodes; i++) order[i] = i;
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
        return colour[a] != colour[b] ? colour[a] < colour[b] : before[a] < before[b];
    });
    return order;
}

Column column(const Field& f) { return {f.data(), nullptr}; }
Column column(const Buffer& f) { return {nullptr, f.data()}; }

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

// A combination of the span; the first of its fields, u, is not listed. Room for one more.
struct Multigrid::Start {
    int count, slot[most_span];
    const float *field[1 + most_span], *image[most_span];
    double coefficient[1 + most_span], f[most_columns];
};

struct Multigrid::Ordered {
    std::vector<int> order, inside;
    std::vector<double> node;
    std::vector<int32_t> tet;
    std::vector<uint8_t> held;
    Elements mesh;

    explicit Ordered(const Elements& given) : order(by_colour(given)), inside(given.nodes), mesh(given) {
        for (int k = 0; k < given.nodes; k++) {
            const int i = order[k];
            inside[i] = k;
            node.insert(node.end(), given.node + 3 * size_t(i), given.node + 3 * size_t(i) + 3);
            held.push_back(given.held[i]);
        }
        for (size_t k = 0; k < 4 * size_t(given.tets); k++) tet.push_back(inside[given.tet[k]]);
        mesh.node = node.data(), mesh.tet = tet.data(), mesh.held = held.data();
    }
};

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
