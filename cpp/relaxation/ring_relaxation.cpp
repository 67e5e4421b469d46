#include "relaxation/ring_relaxation.h"
#include <algorithm>

namespace palpate {
namespace {
constexpr int capacity = ContactPatch::capacity;
}

BreadthFirstRings::BreadthFirstRings(int nodes) : order(nodes), ring(nodes, 1) {
    for (int i = 0; i < nodes; i++) order[i] = i;
}

void BreadthFirstRings::build(const SparsityPattern& graph, const int* touched, int count) {
    const int nodes = graph.nodes();
    std::fill(ring.begin(), ring.end(), 0);
    int tail = 0;
    for (; tail < count; tail++) order[tail] = touched[tail], ring[touched[tail]] = 1;
    for (int head = 0; head < tail; head++) {
        int i = order[head];
        for (int k = graph.start[i]; k < graph.start[i + 1]; k++)
            if (int j = graph.column[k]; ring[j] == 0) ring[j] = ring[i] + 1, order[tail++] = j;
    }
    ring_count = tail > 0 ? ring[order[tail - 1]] : 0;
    if (tail == nodes) return;
    ring_count++; // nodes that no path reaches
    for (int i = 0; i < nodes; i++)
        if (ring[i] == 0) ring[i] = ring_count, order[tail++] = i;
}

RingRelaxationState::RingRelaxationState(int nodes, int unknowns, bool springs)
    : rings(nodes), contact_nodes(capacity), contact_index(nodes, -1),
      weight(size_t(RingRelaxation::most_contacts) * capacity), new_weight(weight.size()),
      saddle(capacity * unknowns, RingRelaxation::most_contacts * unknowns), rhs(3 * capacity),
      home_spring(springs ? nodes : 0), spring_sum(home_spring.size()), step(home_spring.size()),
      padded_u(4 * home_spring.size()) {
    u.assign(3 * size_t(nodes), 0);
}

RingRelaxation::RingRelaxation(SparsityPattern g, std::vector<uint8_t> h, double r, int n)
    : graph(std::move(g)), fixed(std::move(h)), relaxation(r), unknowns(n) {}

std::unique_ptr<ModelState> RingRelaxation::make_state() const {
    auto state = std::make_unique<RingRelaxationState>(nodes(), unknowns, unknowns == 1);
    state->owner = this;
    update_stiffness(*state);
    return state;
}

bool RingRelaxation::relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed,
                           double* displacement, int sweeps, double* force) const {
    std::fill_n(force, 3 * prescribed, 0.0);
    const bool good = solve(state, patches, prescribed, displacement, sweeps, force);
    observe_patches(state, patches, prescribed, observed, displacement, force);
    return good;
}

bool RingRelaxation::solve(ModelState& state, const ContactPatch* patches, int contacts, const double* displacement,
                           int sweeps, double* force) const {
    auto& s = static_cast<RingRelaxationState&>(state);
    if (!set_contacts(s, patches, contacts)) return false;
    begin_sweeps(s);
    for (int k = 0; k < sweeps; k++) {
        if (contacts > 0) solve_contact_nodes(s, displacement, force);
        sweep(s, s.contact_node_count);
        if (k % 4 == 3 || k == sweeps - 1) deflate(s); // slow modes need it less often than every sweep
    }
    end_sweeps(s);
    if (contacts > 0) solve_contact_nodes(s, displacement, force);
    return true;
}

// Takes over the patches; refactors only what they change.
bool RingRelaxation::set_contacts(RingRelaxationState& s, const ContactPatch* patches, int contacts) const {
    if (contacts > most_contacts) return false;
    std::fill_n(s.new_weight.begin(), size_t(contacts) * capacity, 0.0);
    int present = 0, all = 0;
    for (int c = 0; c < contacts; c++)
        for (int k = 0; k < patches[c].count; k++, all++)
            if (int at = s.contact_index[patches[c].node[k]]; at >= 0)
                present++, s.new_weight[c * capacity + at] = patches[c].weight[k];
    bool nodes_changed = present < all;
    for (int at = 0; at < s.contact_node_count && !nodes_changed; at++) {
        double any = 0;
        for (int c = 0; c < contacts; c++) any += s.new_weight[c * capacity + at];
        nodes_changed = any == 0; // a node has left the patches
    }
    bool same = !nodes_changed && contacts == s.contacts && s.independent &&
                std::equal(s.new_weight.begin(), s.new_weight.begin() + size_t(contacts) * capacity, s.weight.begin());
    if (same) return true;
    if (nodes_changed) {
        for (int at = 0; at < s.contact_node_count; at++) s.contact_index[s.contact_nodes[at]] = -1;
        s.contact_node_count = 0;
        std::fill_n(s.new_weight.begin(), size_t(contacts) * capacity, 0.0);
        for (int c = 0; c < contacts; c++)
            for (int k = 0; k < patches[c].count; k++) {
                int i = patches[c].node[k];
                if (s.contact_index[i] < 0) {
                    if (s.contact_node_count == capacity) {
                        for (int at = 0; at < s.contact_node_count; at++) s.contact_index[s.contact_nodes[at]] = -1;
                        s.contact_node_count = s.contacts = 0;
                        set_mode_constraints(s);
                        return false;
                    }
                    s.contact_index[i] = s.contact_node_count;
                    s.contact_nodes[s.contact_node_count++] = i;
                }
                s.new_weight[c * capacity + s.contact_index[i]] = patches[c].weight[k];
            }
        if (s.contact_node_count > 0) // without contact the last rings stay in use
            s.rings.build(graph, s.contact_nodes.data(), s.contact_node_count);
    }
    std::copy_n(s.new_weight.begin(), size_t(contacts) * capacity, s.weight.begin());
    s.contacts = contacts;
    set_mode_constraints(s);
    if (contacts == 0) return s.independent = true;
    if (nodes_changed || stiffness_depends_on_weights()) {
        update_stiffness(s);
        if (rigid_contact()) return s.independent = true;
        contact_matrix(s, s.saddle.matrix(unknowns * s.contact_node_count));
        s.saddle.factor();
    }
    if (rigid_contact()) return s.independent = true;
    factor_constraints(s);
    return s.independent;
}

void RingRelaxation::factor_constraints(RingRelaxationState& s) const {
    const int n = unknowns * s.contact_node_count, m = unknowns * s.contacts;
    double* W = s.saddle.constraints(m);
    std::fill_n(W, size_t(m) * n, 0.0);
    for (int c = 0; c < s.contacts; c++)
        for (int at = 0; at < s.contact_node_count; at++)
            for (int k = 0; k < unknowns; k++)
                W[size_t(c * unknowns + k) * n + at * unknowns + k] = s.weight[c * capacity + at];
    s.independent = s.saddle.factor_constraints();
}

// Ring 1: the contact nodes in equilibrium with their neighbours as these are now, under the tools' constraints.
void RingRelaxation::solve_contact_nodes(RingRelaxationState& s, const double* displacement, double* force) const {
    if (rigid_contact()) return apply_rigid_contact(s, displacement, force);
    contact_rhs(s);
    double* rhs = s.rhs.data();
    double mean[3 * most_contacts];
    if (unknowns == 3) {
        std::copy_n(displacement, 3 * s.contacts, mean);
        s.saddle.solve(rhs, mean);
        for (int at = 0; at < s.contact_node_count; at++)
            std::copy_n(rhs + 3 * at, 3, &s.u[3 * size_t(s.contact_nodes[at])]);
        for (int k = 0; k < 3 * s.contacts; k++) force[k] = -mean[k];
        return;
    }
    for (int k = 0; k < 3; k++) {
        for (int c = 0; c < s.contacts; c++) mean[c] = displacement[3 * c + k];
        s.saddle.solve(rhs + k * s.contact_node_count, mean);
        for (int at = 0; at < s.contact_node_count; at++)
            s.u[3 * size_t(s.contact_nodes[at]) + k] = rhs[k * s.contact_node_count + at];
        for (int c = 0; c < s.contacts; c++) force[3 * c + k] = -mean[c];
    }
}

void RingRelaxation::residual(const ModelState& state, const double* force, double* out) const {
    const auto& s = static_cast<const RingRelaxationState&>(state);
    internal_force(s, out);
    for (int i = 0; i < nodes(); i++) {
        const bool given = fixed[i] || (rigid_contact() && s.contact_index[i] >= 0); // no unknown, so no residual
        for (int k = 0; k < 3; k++) {
            double& r = out[3 * size_t(i) + k];
            if (s.contact_index[i] >= 0)
                for (int c = 0; c < s.contacts; c++)
                    r += s.weight[c * capacity + s.contact_index[i]] * force[3 * c + k];
            r = given ? 0 : -r;
        }
    }
}

void RingRelaxation::energy_and_residual(const ModelState& state, const double* force, double* energy,
                                         double* residual) const {
    const auto& s = static_cast<const RingRelaxationState&>(state);
    std::vector<double> u_force(s.u.size()), r(s.u.size());
    internal_force(s, u_force.data());
    this->residual(state, force, r.data());
    *energy = *residual = 0;
    for (int i = 0; i < nodes(); i++) {
        if (fixed[i]) continue;
        for (int k = 0; k < 3; k++) *energy += 0.5 * s.u[3 * size_t(i) + k] * u_force[3 * size_t(i) + k];
        *residual += 0.5 * preconditioned_norm2(s, i, &r[3 * size_t(i)]);
    }
}

} // namespace palpate
