#include "springs.h"
#include "lanes.h"
#include "quad.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int sums = 4;

// u: four numbers a node, the last of no meaning. weight: relaxation / (sum + home), 0 where the node stands still.
// Several sums, so that an edge need not wait for the one before it.
PALPATE_KERNEL void sweep(const int* order, int count, const int* start, const int* neighbour, const double* stiffness,
                          const double* total, const double* weight, double* u) {
    for (int n = 0; n < count; n++) {
        const int i = order[n], last = start[i + 1];
        Quad pull[sums] = {}, v, x;
        int e = start[i];
        for (; e + sums <= last; e += sums) {
            PALPATE_UNROLL
            for (int k = 0; k < sums; k++) {
                load(x, u + 4 * size_t(neighbour[e + k]));
                pull[k] += stiffness[e + k] * x;
            }
        }
        for (; e < last; e++) {
            load(x, u + 4 * size_t(neighbour[e]));
            pull[0] += stiffness[e] * x;
        }
        load(v, u + 4 * size_t(i));
        store(u + 4 * size_t(i), v + weight[i] * ((pull[0] + pull[1]) + (pull[2] + pull[3]) - total[i] * v));
    }
}

} // namespace

double SpringLaw::operator()(double row) const {
    switch (kind) {
    case Kind::uniform:
        return a;
    case Kind::linear:
        return a * row;
    case Kind::exponential:
        return 1 - std::exp(a * row);
    }
    return a;
}

Springs::Springs(const int32_t* start, const int32_t* column, const double* k, const double* x, int nodes,
                 std::vector<uint8_t> h, SpringLaw l, double r, bool imposed)
    : RingModel({{start, start + nodes + 1}, {column, column + start[nodes]}}, std::move(h), r, 1),
      stiffness(k, k + start[nodes]), sum(nodes, 0), position(x, x + 3 * size_t(nodes)), law(l), rigid(imposed) {
    for (int i = 0; i < nodes; i++)
        for (int e = start[i]; e < start[i + 1]; e++) sum[i] += stiffness[e];
}

// Home springs: RSC of the row times the mean of the node's edge springs.
void Springs::prepare(RingState& s) const {
    double centre[3 * most_contacts] = {};
    for (int c = 0; c < s.contacts; c++)
        for (int at = 0; at < s.count; at++)
            for (int k = 0; k < 3; k++)
                centre[3 * c + k] += s.weight[c * Patch::capacity + at] * position[3 * size_t(s.touched[at]) + k];
    for (int i = 0; i < nodes(); i++) {
        double row = s.rings.row[i];
        if (law.by_distance && s.contacts > 0) {
            double nearest = 1e300;
            for (int c = 0; c < s.contacts; c++) {
                double square = 0;
                for (int k = 0; k < 3; k++) {
                    double d = position[3 * size_t(i) + k] - centre[3 * c + k];
                    square += d * d;
                }
                nearest = std::min(nearest, square);
            }
            row = 1 + std::sqrt(nearest) / law.edge;
        }
        s.home[i] = law(row) * sum[i] / (graph.start[i + 1] - graph.start[i]);
        s.total[i] = sum[i] + s.home[i];
        s.share[i] = held[i] ? 0 : relaxation / s.total[i];
    }
}

void Springs::touched_matrix(RingState& s, double* A) const {
    const size_t n = s.count;
    std::fill_n(A, n * n, 0.0);
    for (int at = 0; at < s.count; at++) {
        const int i = s.touched[at];
        A[at * n + at] = sum[i] + s.home[i];
        for (int e = graph.start[i]; e < graph.start[i + 1]; e++)
            if (int other = s.place[graph.neighbour[e]]; other >= 0) A[at * n + other] = -stiffness[e];
    }
}

void Springs::touched_right(RingState& s) const {
    for (int at = 0; at < s.count; at++) {
        const int i = s.touched[at];
        double pull[3] = {0, 0, 0};
        for (int e = graph.start[i]; e < graph.start[i + 1]; e++)
            if (s.place[graph.neighbour[e]] < 0)
                for (int k = 0; k < 3; k++) pull[k] += stiffness[e] * s.wide[4 * size_t(graph.neighbour[e]) + k];
        for (int k = 0; k < 3; k++) s.right[k * s.count + at] = pull[k];
    }
}

void Springs::enter(RingState& s) const {
    for (size_t i = 0; i < size_t(nodes()); i++) std::copy_n(&s.u[3 * i], 3, &s.wide[4 * i]);
}

void Springs::relax(RingState& s, int first) const {
    for (int at = 0; at < s.count; at++)
        std::copy_n(&s.u[3 * size_t(s.touched[at])], 3, &s.wide[4 * size_t(s.touched[at])]);
    sweep(s.rings.order.data() + first, nodes() - first, graph.start.data(), graph.neighbour.data(), stiffness.data(),
          s.total.data(), s.share.data(), s.wide.data());
}

void Springs::leave(RingState& s) const {
    for (size_t i = 0; i < size_t(nodes()); i++) std::copy_n(&s.wide[4 * i], 3, &s.u[3 * i]);
}

// K u at one node: the force that it needs from outside.
void Springs::pull(const RingState& s, int i, double out[3]) const {
    for (int k = 0; k < 3; k++) out[k] = (sum[i] + s.home[i]) * s.u[3 * size_t(i) + k];
    for (int e = graph.start[i]; e < graph.start[i + 1]; e++)
        for (int k = 0; k < 3; k++) out[k] -= stiffness[e] * s.u[3 * size_t(graph.neighbour[e]) + k];
}

void Springs::internal_force(const State& state, double* out) const {
    const auto& s = static_cast<const RingState&>(state);
    for (int i = 0; i < nodes(); i++) pull(s, i, out + 3 * size_t(i));
}

void Springs::impose(RingState& s, const double* displacement, double* force) const {
    for (int c = 0; c < s.contacts; c++)
        for (int at = 0; at < s.count; at++)
            if (s.weight[c * Patch::capacity + at] > 0)
                std::copy_n(displacement + 3 * c, 3, &s.u[3 * size_t(s.touched[at])]);
    for (int c = 0; c < s.contacts; c++) {
        double total[3] = {0, 0, 0}, one[3];
        for (int at = 0; at < s.count; at++) {
            if (!(s.weight[c * Patch::capacity + at] > 0)) continue;
            pull(s, s.touched[at], one);
            for (int k = 0; k < 3; k++) total[k] += one[k];
        }
        for (int k = 0; k < 3; k++) force[3 * c + k] = -total[k];
    }
}

double Springs::weighed(const RingState& s, int i, const double r[3]) const {
    return (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) / (sum[i] + s.home[i]);
}

double Springs::contraction(const State& state) const {
    const auto& s = static_cast<const RingState&>(state);
    double least = 1;
    for (int i = 0; i < nodes(); i++)
        if (!held[i]) least = std::min(least, s.home[i] / (sum[i] + s.home[i]));
    return least;
}

} // namespace palpate
