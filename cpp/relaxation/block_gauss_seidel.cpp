#include "relaxation/block_gauss_seidel.h"
#include "base/cpu_dispatch.h"
#include <algorithm>

namespace palpate {
namespace {

SparsityPattern edges(const SparsityPattern& K) {
    SparsityPattern graph;
    for (int i = 0; i < K.nodes(); i++) {
        for (int k = K.start[i]; k < K.start[i + 1]; k++)
            if (K.column[k] != i) graph.column.push_back(K.column[k]);
        graph.start.push_back(int(graph.column.size()));
    }
    return graph;
}

// sum[0..3] += the blocks of edges first .. last times u of their neighbours.
PALPATE_INLINE void gather(const double* block, const int* neighbour, const double* u, int first, int last,
                           double sum[4]) {
    for (int e = first; e < last; e++) {
        const double* b = block + 12 * size_t(e);
        const double* v = u + 3 * size_t(neighbour[e]);
        for (int k = 0; k < 4; k++) sum[k] += b[k] * v[0] + b[4 + k] * v[1] + b[8 + k] * v[2];
    }
}

PALPATE_KERNEL void sweep_nodes(const int* order, int count, const uint8_t* fixed, const int* start,
                                const int* neighbour, const double* block, const double* inverse, double relaxation,
                                double* u) {
    for (int n = 0; n < count; n++) {
        const int i = order[n];
        if (fixed[i]) continue;
        double g[4] = {0, 0, 0, 0};
        gather(block, neighbour, u, start[i], start[i + 1], g);
        const double* m = inverse + 9 * size_t(i);
        double* v = u + 3 * size_t(i);
        for (int k = 0; k < 3; k++)
            v[k] -= relaxation * (v[k] + m[3 * k] * g[0] + m[3 * k + 1] * g[1] + m[3 * k + 2] * g[2]);
    }
}

PALPATE_KERNEL void multiply(int nodes, const int* start, const int* neighbour, const double* block,
                             const double* diagonal, const double* u, double* out) {
    for (int i = 0; i < nodes; i++) {
        double g[4] = {0, 0, 0, 0};
        gather(block, neighbour, u, start[i], start[i + 1], g);
        const double* d = diagonal + 9 * size_t(i);
        const double* v = u + 3 * size_t(i);
        for (int k = 0; k < 3; k++)
            out[3 * size_t(i) + k] = g[k] + d[3 * k] * v[0] + d[3 * k + 1] * v[1] + d[3 * k + 2] * v[2];
    }
}

} // namespace

BlockGaussSeidel::BlockGaussSeidel(const BlockCsr& K, std::vector<uint8_t> h, double r, ModeDeflation slow)
    : RingRelaxation(edges(K), std::move(h), r, 3), block(12 * graph.column.size()), diagonal(9 * size_t(nodes())),
      inverse(9 * size_t(nodes())), modes(std::move(slow)) {
    size_t edge = 0;
    for (int i = 0; i < nodes(); i++)
        for (int k = K.start[i]; k < K.start[i + 1]; k++) {
            const double* from = &K.block[9 * size_t(k)];
            if (K.column[k] == i) {
                std::copy_n(from, 9, &diagonal[9 * size_t(i)]);
                invert_block(from, &inverse[9 * size_t(i)]);
                continue;
            }
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) block[12 * edge + 4 * b + a] = from[3 * a + b];
            edge++;
        }
}

void BlockGaussSeidel::internal_force(const ModelState& state, double* out) const {
    multiply(nodes(), graph.start.data(), graph.column.data(), block.data(), diagonal.data(), state.u.data(), out);
}

void BlockGaussSeidel::contact_matrix(RingRelaxationState& s, double* A) const {
    const size_t n = 3 * size_t(s.contact_node_count);
    std::fill_n(A, n * n, 0.0);
    for (int at = 0; at < s.contact_node_count; at++) {
        const int i = s.contact_nodes[at];
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) A[(3 * at + a) * n + 3 * at + b] = diagonal[9 * size_t(i) + 3 * a + b];
        for (int e = graph.start[i]; e < graph.start[i + 1]; e++) {
            const int other = s.contact_index[graph.column[e]];
            if (other < 0) continue;
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) A[(3 * at + a) * n + 3 * other + b] = block[12 * size_t(e) + 4 * b + a];
        }
    }
}

void BlockGaussSeidel::contact_rhs(RingRelaxationState& s) const {
    for (int at = 0; at < s.contact_node_count; at++) {
        const int i = s.contact_nodes[at];
        double g[4] = {0, 0, 0, 0};
        for (int e = graph.start[i]; e < graph.start[i + 1]; e++)
            if (s.contact_index[graph.column[e]] < 0)
                gather(block.data(), graph.column.data(), s.u.data(), e, e + 1, g);
        for (int k = 0; k < 3; k++) s.rhs[3 * at + k] = -g[k];
    }
}

void BlockGaussSeidel::sweep(RingRelaxationState& s, int first) const {
    sweep_nodes(s.rings.order.data() + first, nodes() - first, fixed.data(), graph.start.data(), graph.column.data(),
                block.data(), inverse.data(), relaxation, s.u.data());
}

void BlockGaussSeidel::set_mode_constraints(RingRelaxationState& s) const {
    if (!modes.empty())
        modes.constrain(s.contact_nodes.data(), s.contact_node_count, s.weight.data(), s.contacts, s.mode_constraints);
}

void BlockGaussSeidel::deflate(RingRelaxationState& s) const {
    if (!modes.empty()) modes.deflate(s.mode_constraints, s.u.data());
}

double BlockGaussSeidel::preconditioned_norm2(const RingRelaxationState&, int i, const double r[3]) const {
    const double* m = &inverse[9 * size_t(i)];
    double sum = 0;
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) sum += r[a] * m[3 * a + b] * r[b];
    return sum;
}

} // namespace palpate
