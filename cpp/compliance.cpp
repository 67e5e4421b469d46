#include "compliance.h"
#include "ahead.h"
#include "dense.h"
#include "dispatch.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int capacity = Patch::capacity;
// Of what a stiffness from older tables was off by, this much is left after a tick; but it never changes the force by
// more than this part of it a tick (a hand feels steps of some per cent).
constexpr double fading = 0.95, most_step = 0.015;

constexpr int most = 3 * most_tools;
enum At {
    closed_at = 0,
    open_at = 1,
    force_at = 2,
    displacement_at = force_at + most,
    stiffness_at = displacement_at + most,
    offset_at = stiffness_at + most * most,
    known_at = offset_at + most * most,
    size = known_at + 1
};

// out = a^-1, a 3x3 or larger; a is lost. False: some contacts cannot be told apart.
bool invert(double* a, int n, double* out) {
    if (n == 3) {
        const double c[9] = {a[4] * a[8] - a[5] * a[7], a[2] * a[7] - a[1] * a[8], a[1] * a[5] - a[2] * a[4],
                             a[5] * a[6] - a[3] * a[8], a[0] * a[8] - a[2] * a[6], a[2] * a[3] - a[0] * a[5],
                             a[3] * a[7] - a[4] * a[6], a[1] * a[6] - a[0] * a[7], a[0] * a[4] - a[1] * a[3]};
        const double determinant = a[0] * c[0] + a[1] * c[3] + a[2] * c[6];
        for (int k = 0; k < 9; k++) out[k] = c[k] / determinant;
        return true;
    }
    factor_independent(a, n, 1e-6); // C = L L'
    for (int k = 0; k < n; k++)
        if (!(a[k * n + k] > 0)) return false;
    for (int k = 0; k < n; k++) {
        double column[most] = {};
        column[k] = 1;
        solve_positive(a, n, column);
        for (int r = 0; r < n; r++) out[r * n + k] = column[r];
    }
    return true;
}

double along(const double* a, int n, const double* d) { // |a d|
    double sum = 0;
    for (int k = 0; k < n; k++) {
        double x = 0;
        for (int c = 0; c < n; c++) x += a[k * n + c] * d[c];
        sum += x * x;
    }
    return std::sqrt(sum);
}

double norm(const double* a, int n) {
    double sum = 0;
    for (int k = 0; k < n; k++) sum += a[k] * a[k];
    return std::sqrt(sum);
}

// sum over all pairs of w_i w_j G_ij, from those i >= j. Numerical kernel.
PALPATE_KERNEL void weigh(const float* block, const double* weight, int count, double out[9]) {
    double half[9] = {};
    for (int i = 0; i < count; i++) {
        double mine[9] = {};
        for (int j = 0; j <= i; j++, block += 9) {
            const double w = j < i ? weight[j] : 0.5 * weight[j];
            for (int k = 0; k < 9; k++) mine[k] += w * block[k];
        }
        for (int k = 0; k < 9; k++) half[k] += weight[i] * mine[k];
    }
    for (int k = 0; k < 9; k++) out[k] = half[k] + half[3 * (k % 3) + k / 3];
}

// The same between two patches: sum over all i, j of v_i w_j G_ij. Numerical kernel.
PALPATE_KERNEL void weigh_across(const float* block, const double* v, const double* w, int count, double out[9]) {
    double sum[9] = {};
    for (int i = 0; i < count; i++)
        for (int j = 0; j <= i; j++, block += 9) {
            const double there = v[i] * w[j], back = j < i ? v[j] * w[i] : 0;
            if (there == 0 && back == 0) continue;
            for (int k = 0; k < 9; k++) sum[k] += there * block[k] + back * block[3 * (k % 3) + k / 3];
        }
    for (int k = 0; k < 9; k++) out[k] = sum[k];
}

} // namespace

ComplianceState::ComplianceState(const Elastic& elastic, size_t budget)
    : kept(size, 0.0), green(elastic, budget), weight(most_tools * capacity), field(3 * size_t(elastic.vertices())) {
    for (Pairs* p : {&pairs, &spare}) {
        p->vertex.resize(capacity);
        p->block.resize(size_t(9) * capacity * (capacity + 1) / 2);
        p->known.resize(size_t(capacity) * (capacity + 1) / 2);
    }
    u.assign(3 * size_t(elastic.nodes()), 0);
}
ComplianceState::~ComplianceState() = default;

void Touch::copy(const Touch& other) {
    serial = other.serial, count = other.count;
    std::copy_n(other.vertex, count, vertex);
    std::copy_n(other.weight, count, weight);
    std::copy_n(other.load, 3 * count, load);
}

Compliance::Compliance(Elastic e, size_t budget) : elastic(std::move(e)), budget(budget) {}

std::unique_ptr<State> Compliance::start() const {
    auto state = std::make_unique<ComplianceState>(elastic, budget);
    state->owner = this;
    return state;
}

bool Compliance::advance(State& state, const Patch* patches, int closed, int open, double* displacement, int,
                         double* force) const {
    auto& s = static_cast<ComplianceState&>(state);
    s.touch.serial++;
    bool good = true;
    if (closed > 0) {
        if (!seat(s, patches, closed + open)) return false;
        take_count(s, closed);
        s.kept[open_at] = open;
        if (s.tables != Tables::without) fetch(s.green, s.pairs);
        if (s.pairs.lacking > 0 && s.tables == Tables::at_once) make_now(s);
        s.cold = s.pairs.lacking > 0 || s.tables == Tables::without;
        s.cold_ticks += s.cold;
        good = take_stiffness(s, closed, displacement);
        if (good) answer(s, closed, displacement, force);
        feel_others(s, closed, open, displacement, force);
    } else {
        let_go(s);
        std::fill_n(displacement, 3 * open, 0.0);
        std::fill_n(force, 3 * open, 0.0);
    }
    if (s.tables == Tables::ahead) {
        s.touches.writing().copy(s.touch);
        s.touches.publish();
    }
    return good;
}

// Contacts that come are the last ones: of those before, the stiffness serves on. When one goes nothing of it fits.
void Compliance::take_count(ComplianceState& s, int closed) const {
    const int was = 3 * int(s.kept[closed_at]), n = 3 * closed;
    if (was == n) return;
    double before[size];
    std::copy_n(s.kept.begin(), size, before);
    std::fill(s.kept.begin(), s.kept.end(), 0.0);
    s.kept[closed_at] = closed;
    if (was > n || was == 0) return;
    s.kept[known_at] = before[known_at];
    for (int i = 0; i < was; i++)
        for (int j = 0; j < was; j++)
            for (int at : {int(stiffness_at), int(offset_at)}) s.kept[at + n * i + j] = before[at + was * i + j];
}

void Compliance::let_go(ComplianceState& s) const {
    std::fill_n(s.memory().begin(), size, 0.0);
    s.touch.count = 0;
    s.cold = s.fading = false;
}

// The exact stiffness, or the last one where blocks lack; then the exact one again as what was off fades.
bool Compliance::take_stiffness(ComplianceState& s, int closed, const double* displacement) const {
    double* kept = s.memory().data();
    double *stiffness = kept + stiffness_at, *offset = kept + offset_at;
    if (s.cold) {
        kept[known_at] = -1;
        s.fading = true;
        return true;
    }
    const int n = 3 * closed;
    double C[most * most], exact[most * most], part[9];
    for (int a = 0; a < closed; a++)
        for (int b = 0; b <= a; b++) {
            const double *v = &s.weight[a * capacity], *w = &s.weight[b * capacity];
            if (a == b)
                weigh(s.pairs.block.data(), v, s.pairs.count, part);
            else
                weigh_across(s.pairs.block.data(), v, w, s.pairs.count, part);
            for (int k = 0; k < 9; k++) C[(3 * a + k / 3) * n + 3 * b + k % 3] = part[k];
        }
    if (!invert(C, n, exact)) return false;
    if (kept[known_at] < 0)
        for (int k = 0; k < n * n; k++) offset[k] = stiffness[k] - exact[k];
    const double off = along(offset, n, displacement), step = most_step * along(exact, n, displacement);
    const double left = off * (1 - fading) > step ? 1 - step / off : fading;
    const bool gone = norm(offset, n * n) < 1e-8 * norm(exact, n * n);
    for (int k = 0; k < n * n; k++) {
        offset[k] = gone ? 0 : left * offset[k];
        stiffness[k] = exact[k] + offset[k];
    }
    kept[known_at] = 1;
    s.fading = norm(offset, n * n) > 0.02 * norm(exact, n * n);
    return true;
}

void Compliance::answer(ComplianceState& s, int closed, const double* displacement, double* force) const {
    double* kept = s.memory().data();
    const int n = 3 * closed;
    for (int k = 0; k < n; k++) {
        force[k] = 0;
        for (int c = 0; c < n; c++) force[k] -= kept[stiffness_at + n * k + c] * displacement[c];
        kept[force_at + k] = force[k];
        kept[displacement_at + k] = displacement[k];
    }
    s.touch.count = s.pairs.count;
    std::copy_n(s.pairs.vertex.data(), s.pairs.count, s.touch.vertex);
    for (int i = 0; i < s.pairs.count; i++) {
        double all = 0, load[3] = {0, 0, 0};
        for (int a = 0; a < closed; a++) {
            const double w = s.weight[a * capacity + i];
            all += w;
            for (int k = 0; k < 3; k++) load[k] -= w * force[3 * a + k];
        }
        s.touch.weight[i] = all / closed;
        std::copy_n(load, 3, &s.touch.load[3 * i]);
    }
}

// Where patches that only feel have gone: C of them with those that hold, times the forces. Where blocks lack: as last.
void Compliance::feel_others(ComplianceState& s, int closed, int open, double* displacement, double* force) const {
    double* kept = s.memory().data();
    for (int o = closed; o < closed + open; o++) {
        double* moved = kept + displacement_at + 3 * o;
        if (!s.cold) {
            std::fill_n(moved, 3, 0.0);
            for (int a = 0; a < closed; a++) {
                double part[9];
                weigh_across(s.pairs.block.data(), &s.weight[o * capacity], &s.weight[a * capacity], s.pairs.count,
                             part);
                for (int k = 0; k < 9; k++) moved[k / 3] -= part[k] * force[3 * a + k % 3];
            }
        }
        std::copy_n(moved, 3, displacement + 3 * o);
        std::fill_n(force + 3 * o, 3, 0.0);
    }
}

void Compliance::accompany(State& state) const {
    auto& s = static_cast<ComplianceState&>(state);
    s.ahead = std::make_unique<Ahead>(elastic, s.green, s.touches);
    s.tables = Tables::ahead;
}

void Compliance::leave(State& state) const {
    auto& s = static_cast<ComplianceState&>(state);
    s.tables = Tables::at_once;
    s.ahead.reset();
}

} // namespace palpate
