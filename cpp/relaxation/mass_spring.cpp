#include "relaxation/mass_spring.h"
#include "base/simd.h"
#include "base/vec3.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int sums = 4;

// u: four numbers per node, the last unused. weight: relaxation / (sum + home), 0 for fixed nodes. Several sums, so
// that the additions do not depend on each other.
PALPATE_KERNEL void sweep_nodes(const int* order, int count, const int* start, const int* neighbour,
                                const double* stiffness, const double* total, const double* weight, double* u) {
    for (int n = 0; n < count; n++) {
        const int i = order[n], last = start[i + 1];
        f64x4 force[sums] = {}, v, x;
        int e = start[i];
        for (; e + sums <= last; e += sums) {
            PALPATE_UNROLL
            for (int k = 0; k < sums; k++) {
                load(x, u + 4 * size_t(neighbour[e + k]));
                force[k] += stiffness[e + k] * x;
            }
        }
        for (; e < last; e++) {
            load(x, u + 4 * size_t(neighbour[e]));
            force[0] += stiffness[e] * x;
        }
        load(v, u + 4 * size_t(i));
        store(u + 4 * size_t(i), v + weight[i] * ((force[0] + force[1]) + (force[2] + force[3]) - total[i] * v));
    }
}

} // namespace

double SpringLaw::operator()(double ring) const {
    switch (kind) {
    case Kind::uniform:
        return a;
    case Kind::linear:
        return a * ring;
    case Kind::exponential:
        return 1 - std::exp(a * ring);
    }
    return a;
}

MassSpring::MassSpring(SparsityPattern edges, const double* k, const double* x, std::vector<uint8_t> h, SpringLaw l,
                       double r, bool rigid)
    : RingRelaxation(std::move(edges), std::move(h), r, 1), stiffness(k, k + graph.column.size()), edge_sum(nodes(), 0),
      position(x, x + 3 * size_t(nodes())), law(l), rigid(rigid) {
    for (int i = 0; i < nodes(); i++)
        for (int e = graph.start[i]; e < graph.start[i + 1]; e++) edge_sum[i] += stiffness[e];
}

// Home springs: RSC of the ring times the mean of the node's edge springs.
void MassSpring::update_stiffness(RingRelaxationState& s) const {
    double centre[3 * most_contacts] = {};
    for (int c = 0; c < s.contacts; c++)
        for (int at = 0; at < s.contact_node_count; at++)
            for (int k = 0; k < 3; k++)
                centre[3 * c + k] +=
                    s.weight[c * ContactPatch::capacity + at] * position[3 * size_t(s.contact_nodes[at]) + k];
    for (int i = 0; i < nodes(); i++) {
        double ring = s.rings.ring[i];
        if (law.by_distance && s.contacts > 0) {
            double nearest = 1e300;
            for (int c = 0; c < s.contacts; c++)
                nearest = std::min(nearest, square_of_distance(&position[3 * size_t(i)], centre + 3 * c));
            ring = 1 + std::sqrt(nearest) / law.edge;
        }
        s.home_spring[i] = law(ring) * edge_sum[i] / (graph.start[i + 1] - graph.start[i]);
        s.spring_sum[i] = edge_sum[i] + s.home_spring[i];
        s.step[i] = fixed[i] ? 0 : relaxation / s.spring_sum[i];
    }
}

void MassSpring::contact_matrix(RingRelaxationState& s, double* A) const {
    const size_t n = s.contact_node_count;
    std::fill_n(A, n * n, 0.0);
    for (int at = 0; at < s.contact_node_count; at++) {
        const int i = s.contact_nodes[at];
        A[at * n + at] = edge_sum[i] + s.home_spring[i];
        for (int e = graph.start[i]; e < graph.start[i + 1]; e++)
            if (int other = s.contact_index[graph.column[e]]; other >= 0) A[at * n + other] = -stiffness[e];
    }
}

void MassSpring::contact_rhs(RingRelaxationState& s) const {
    for (int at = 0; at < s.contact_node_count; at++) {
        const int i = s.contact_nodes[at];
        double force[3] = {0, 0, 0};
        for (int e = graph.start[i]; e < graph.start[i + 1]; e++)
            if (s.contact_index[graph.column[e]] < 0)
                for (int k = 0; k < 3; k++) force[k] += stiffness[e] * s.padded_u[4 * size_t(graph.column[e]) + k];
        for (int k = 0; k < 3; k++) s.rhs[k * s.contact_node_count + at] = force[k];
    }
}

void MassSpring::begin_sweeps(RingRelaxationState& s) const {
    for (size_t i = 0; i < size_t(nodes()); i++) std::copy_n(&s.u[3 * i], 3, &s.padded_u[4 * i]);
}

void MassSpring::sweep(RingRelaxationState& s, int first) const { sweep_rows(s, first, nodes()); }

void MassSpring::sweep_rows(RingRelaxationState& s, int first, int last) const {
    for (int at = 0; at < s.contact_node_count; at++)
        std::copy_n(&s.u[3 * size_t(s.contact_nodes[at])], 3, &s.padded_u[4 * size_t(s.contact_nodes[at])]);
    sweep_nodes(s.rings.order.data() + first, last - first, graph.start.data(), graph.column.data(), stiffness.data(),
                s.spring_sum.data(), s.step.data(), s.padded_u.data());
}

int MassSpring::solve_rows(ModelState& state, const ContactPatch* patches, int contacts, const double* displacement,
                           double least, int rows, int* sweeps, double* force) const {
    auto& s = static_cast<RingRelaxationState&>(state);
    const int most_sweeps = *sweeps;
    *sweeps = 0;
    if (contacts == 0 || !set_contacts(s, patches, contacts)) return 0;
    std::fill(s.u.begin(), s.u.end(), 0.0);
    begin_sweeps(s);
    const std::vector<int>&order = s.rings.order, &ring = s.rings.ring;
    auto end_of_row = [&](int row) {
        return int(std::upper_bound(order.begin(), order.end(), row, [&](int r, int i) { return r < ring[i]; }) -
                   order.begin());
    };
    auto moved = [&](int n) { return s.padded_u.data() + 4 * size_t(order[n]); };
    rows = std::clamp(rows, 1, s.rings.ring_count);
    int last = end_of_row(rows);
    const double home[3] = {0, 0, 0};
    std::vector<double> before;
    while (*sweeps < most_sweeps) {
        solve_contact_nodes(s, displacement, force);
        before.resize(3 * size_t(last));
        for (int n = 0; n < last; n++) std::copy_n(moved(n), 3, &before[3 * size_t(n)]);
        sweep_rows(s, s.contact_node_count, last);
        ++*sweeps;
        double step = 0, reach = 0;
        for (int n = s.contact_node_count; n < last; n++)
            step = std::max(step, square_of_distance(moved(n), &before[3 * size_t(n)]));
        for (int n = end_of_row(rows - 1); n < last; n++) reach = std::max(reach, square_of_distance(moved(n), home));
        if (rows < s.rings.ring_count && reach >= least * least)
            last = end_of_row(++rows);
        else if (step < least * least)
            break;
    }
    end_sweeps(s);
    solve_contact_nodes(s, displacement, force);
    return rows;
}

void MassSpring::end_sweeps(RingRelaxationState& s) const {
    for (size_t i = 0; i < size_t(nodes()); i++) std::copy_n(&s.padded_u[4 * i], 3, &s.u[3 * i]);
}

// K u at one node: the external force that balances it.
void MassSpring::node_force(const RingRelaxationState& s, int i, double out[3]) const {
    for (int k = 0; k < 3; k++) out[k] = (edge_sum[i] + s.home_spring[i]) * s.u[3 * size_t(i) + k];
    for (int e = graph.start[i]; e < graph.start[i + 1]; e++)
        for (int k = 0; k < 3; k++) out[k] -= stiffness[e] * s.u[3 * size_t(graph.column[e]) + k];
}

void MassSpring::internal_force(const ModelState& state, double* out) const {
    const auto& s = static_cast<const RingRelaxationState&>(state);
    for (int i = 0; i < nodes(); i++) node_force(s, i, out + 3 * size_t(i));
}

void MassSpring::apply_rigid_contact(RingRelaxationState& s, const double* displacement, double* force) const {
    for (int c = 0; c < s.contacts; c++)
        for (int at = 0; at < s.contact_node_count; at++)
            if (s.weight[c * ContactPatch::capacity + at] > 0)
                std::copy_n(displacement + 3 * c, 3, &s.u[3 * size_t(s.contact_nodes[at])]);
    for (int c = 0; c < s.contacts; c++) {
        double total[3] = {0, 0, 0}, one[3];
        for (int at = 0; at < s.contact_node_count; at++) {
            if (!(s.weight[c * ContactPatch::capacity + at] > 0)) continue;
            node_force(s, s.contact_nodes[at], one);
            for (int k = 0; k < 3; k++) total[k] += one[k];
        }
        for (int k = 0; k < 3; k++) force[3 * c + k] = -total[k];
    }
}

double MassSpring::preconditioned_norm2(const RingRelaxationState& s, int i, const double r[3]) const {
    return (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) / (edge_sum[i] + s.home_spring[i]);
}

double MassSpring::eigenvalue_bound(const ModelState& state) const {
    const auto& s = static_cast<const RingRelaxationState&>(state);
    double smallest = 1;
    for (int i = 0; i < nodes(); i++)
        if (!fixed[i]) smallest = std::min(smallest, s.home_spring[i] / (edge_sum[i] + s.home_spring[i]));
    return smallest;
}

} // namespace palpate
