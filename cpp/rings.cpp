#include "rings.h"
#include <algorithm>

namespace palpate {
namespace {
constexpr int capacity = Patch::capacity;
}

Rings::Rings(int nodes) : order(nodes), row(nodes, 1) {
    for (int i = 0; i < nodes; i++) order[i] = i;
}

void Rings::grow(const Graph& graph, const int* touched, int count) {
    const int nodes = graph.nodes();
    std::fill(row.begin(), row.end(), 0);
    int tail = 0;
    for (; tail < count; tail++) order[tail] = touched[tail], row[touched[tail]] = 1;
    for (int head = 0; head < tail; head++) {
        int i = order[head];
        for (int k = graph.start[i]; k < graph.start[i + 1]; k++)
            if (int j = graph.neighbour[k]; row[j] == 0) row[j] = row[i] + 1, order[tail++] = j;
    }
    rows = tail > 0 ? row[order[tail - 1]] : 0;
    if (tail == nodes) return;
    rows++; // what no path reaches
    for (int i = 0; i < nodes; i++)
        if (row[i] == 0) row[i] = rows, order[tail++] = i;
}

RingState::RingState(int nodes, int unknowns, bool springs)
    : rings(nodes), touched(capacity), place(nodes, -1), weight(size_t(RingModel::most_contacts) * capacity),
      fresh(weight.size()), saddle(capacity * unknowns, RingModel::most_contacts * unknowns), right(3 * capacity),
      home(springs ? nodes : 0), total(home.size()), share(home.size()), wide(4 * home.size()) {
    u.assign(3 * size_t(nodes), 0);
}

RingModel::RingModel(Graph g, std::vector<uint8_t> h, double r, int n)
    : graph(std::move(g)), held(std::move(h)), relaxation(r), unknowns(n) {}

std::unique_ptr<State> RingModel::start() const {
    auto state = std::make_unique<RingState>(nodes(), unknowns, unknowns == 1);
    state->owner = this;
    prepare(*state);
    return state;
}

bool RingModel::advance(State& state, const Patch* patches, int closed, int open, double* displacement, int sweeps,
                        double* force) const {
    std::fill_n(force, 3 * closed, 0.0);
    const bool good = solve(state, patches, closed, displacement, sweeps, force);
    feel(state, patches, closed, open, displacement, force);
    return good;
}

bool RingModel::solve(State& state, const Patch* patches, int contacts, const double* displacement, int sweeps,
                      double* force) const {
    auto& s = static_cast<RingState&>(state);
    if (!touch(s, patches, contacts)) return false;
    enter(s);
    for (int k = 0; k < sweeps; k++) {
        if (contacts > 0) hold(s, displacement, force);
        relax(s, s.count);
        if (k % 4 == 3 || k == sweeps - 1) settle(s); // slow shapes need it less often than each sweep
    }
    leave(s);
    if (contacts > 0) hold(s, displacement, force);
    return true;
}

// Takes over the patches, and refactors only what they change.
bool RingModel::touch(RingState& s, const Patch* patches, int contacts) const {
    if (contacts > most_contacts) return false;
    std::fill_n(s.fresh.begin(), size_t(contacts) * capacity, 0.0);
    int known = 0, all = 0;
    for (int c = 0; c < contacts; c++)
        for (int k = 0; k < patches[c].count; k++, all++)
            if (int at = s.place[patches[c].node[k]]; at >= 0)
                known++, s.fresh[c * capacity + at] = patches[c].weight[k];
    bool moved = known < all;
    for (int at = 0; at < s.count && !moved; at++) {
        double any = 0;
        for (int c = 0; c < contacts; c++) any += s.fresh[c * capacity + at];
        moved = any == 0; // a node that was touched is no longer
    }
    bool same = !moved && contacts == s.contacts && s.sound &&
                std::equal(s.fresh.begin(), s.fresh.begin() + size_t(contacts) * capacity, s.weight.begin());
    if (same) return true;
    if (moved) {
        for (int at = 0; at < s.count; at++) s.place[s.touched[at]] = -1;
        s.count = 0;
        std::fill_n(s.fresh.begin(), size_t(contacts) * capacity, 0.0);
        for (int c = 0; c < contacts; c++)
            for (int k = 0; k < patches[c].count; k++) {
                int i = patches[c].node[k];
                if (s.place[i] < 0) {
                    if (s.count == capacity) {
                        for (int at = 0; at < s.count; at++) s.place[s.touched[at]] = -1;
                        s.count = s.contacts = 0;
                        bind(s);
                        return false;
                    }
                    s.place[i] = s.count;
                    s.touched[s.count++] = i;
                }
                s.fresh[c * capacity + s.place[i]] = patches[c].weight[k];
            }
        if (s.count > 0) s.rings.grow(graph, s.touched.data(), s.count); // let go: the last rows serve on the way home
    }
    std::copy_n(s.fresh.begin(), size_t(contacts) * capacity, s.weight.begin());
    s.contacts = contacts;
    bind(s);
    if (contacts == 0) return s.sound = true;
    if (moved || stiffness_follows_weights()) {
        prepare(s);
        if (imposed()) return s.sound = true;
        touched_matrix(s, s.saddle.matrix(unknowns * s.count));
        s.saddle.factor();
    }
    if (imposed()) return s.sound = true;
    constrain(s);
    return s.sound;
}

void RingModel::constrain(RingState& s) const {
    const int n = unknowns * s.count, m = unknowns * s.contacts;
    double* W = s.saddle.constraints(m);
    std::fill_n(W, size_t(m) * n, 0.0);
    for (int c = 0; c < s.contacts; c++)
        for (int at = 0; at < s.count; at++)
            for (int k = 0; k < unknowns; k++)
                W[size_t(c * unknowns + k) * n + at * unknowns + k] = s.weight[c * capacity + at];
    s.sound = s.saddle.factor_constraints();
}

// Row 1: the touched nodes in balance with their neighbours as these now stand, their weighted means where the tools
// are.
void RingModel::hold(RingState& s, const double* displacement, double* force) const {
    if (imposed()) return impose(s, displacement, force);
    touched_right(s);
    double* right = s.right.data();
    double mean[3 * most_contacts];
    if (unknowns == 3) {
        std::copy_n(displacement, 3 * s.contacts, mean);
        s.saddle.solve(right, mean);
        for (int at = 0; at < s.count; at++) std::copy_n(right + 3 * at, 3, &s.u[3 * size_t(s.touched[at])]);
        for (int k = 0; k < 3 * s.contacts; k++) force[k] = -mean[k];
        return;
    }
    for (int k = 0; k < 3; k++) {
        for (int c = 0; c < s.contacts; c++) mean[c] = displacement[3 * c + k];
        s.saddle.solve(right + k * s.count, mean);
        for (int at = 0; at < s.count; at++) s.u[3 * size_t(s.touched[at]) + k] = right[k * s.count + at];
        for (int c = 0; c < s.contacts; c++) force[3 * c + k] = -mean[c];
    }
}

void RingModel::residual(const State& state, const double* force, double* out) const {
    const auto& s = static_cast<const RingState&>(state);
    internal_force(s, out);
    for (int i = 0; i < nodes(); i++) {
        const bool given = held[i] || (imposed() && s.place[i] >= 0); // no unknown, so out of no balance
        for (int k = 0; k < 3; k++) {
            double& r = out[3 * size_t(i) + k];
            if (s.place[i] >= 0)
                for (int c = 0; c < s.contacts; c++) r += s.weight[c * capacity + s.place[i]] * force[3 * c + k];
            r = given ? 0 : -r;
        }
    }
}

void RingModel::balance(const State& state, const double* force, double* energy, double* residual) const {
    const auto& s = static_cast<const RingState&>(state);
    std::vector<double> u_force(s.u.size()), r(s.u.size());
    internal_force(s, u_force.data());
    this->residual(state, force, r.data());
    *energy = *residual = 0;
    for (int i = 0; i < nodes(); i++) {
        if (held[i]) continue;
        for (int k = 0; k < 3; k++) *energy += 0.5 * s.u[3 * size_t(i) + k] * u_force[3 * size_t(i) + k];
        *residual += 0.5 * weighed(s, i, &r[3 * size_t(i)]);
    }
}

} // namespace palpate
