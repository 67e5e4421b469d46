#include "blocks.h"
#include "dispatch.h"
#include <algorithm>

namespace palpate {
namespace {

Graph edges(const int32_t* start, const int32_t* column, int nodes) {
    Graph graph;
    graph.start.push_back(0);
    for (int i = 0; i < nodes; i++) {
        for (int k = start[i]; k < start[i + 1]; k++)
            if (column[k] != i) graph.neighbour.push_back(column[k]);
        graph.start.push_back(int(graph.neighbour.size()));
    }
    return graph;
}

void invert(const double* a, double* out) {
    double c[9] = {a[4] * a[8] - a[5] * a[7], a[2] * a[7] - a[1] * a[8], a[1] * a[5] - a[2] * a[4],
                   a[5] * a[6] - a[3] * a[8], a[0] * a[8] - a[2] * a[6], a[2] * a[3] - a[0] * a[5],
                   a[3] * a[7] - a[4] * a[6], a[1] * a[6] - a[0] * a[7], a[0] * a[4] - a[1] * a[3]};
    double determinant = a[0] * c[0] + a[1] * c[3] + a[2] * c[6];
    for (int k = 0; k < 9; k++) out[k] = c[k] / determinant;
}

// sum[0..3] += the blocks of edges first..last times their neighbours' u.
PALPATE_INLINE void gather(const double* block, const int* neighbour, const double* u, int first, int last,
                           double sum[4]) {
    for (int e = first; e < last; e++) {
        const double* b = block + 12 * size_t(e);
        const double* v = u + 3 * size_t(neighbour[e]);
        for (int k = 0; k < 4; k++) sum[k] += b[k] * v[0] + b[4 + k] * v[1] + b[8 + k] * v[2];
    }
}

PALPATE_KERNEL void sweep(const int* order, int count, const uint8_t* held, const int* start, const int* neighbour,
                          const double* block, const double* inverse, double relaxation, double* u) {
    for (int n = 0; n < count; n++) {
        const int i = order[n];
        if (held[i]) continue;
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

Blocks::Blocks(const int32_t* start, const int32_t* column, const double* values, int nodes, std::vector<uint8_t> h,
               double r, Modes slow)
    : RingModel(edges(start, column, nodes), std::move(h), r, 3), block(12 * graph.neighbour.size()),
      diagonal(9 * size_t(nodes)), inverse(9 * size_t(nodes)), modes(std::move(slow)) {
    size_t edge = 0;
    for (int i = 0; i < nodes; i++)
        for (int k = start[i]; k < start[i + 1]; k++) {
            const double* from = values + 9 * size_t(k);
            if (column[k] == i) {
                std::copy_n(from, 9, &diagonal[9 * size_t(i)]);
                invert(from, &inverse[9 * size_t(i)]);
                continue;
            }
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) block[12 * edge + 4 * b + a] = from[3 * a + b];
            edge++;
        }
}

void Blocks::internal_force(const State& state, double* out) const {
    multiply(nodes(), graph.start.data(), graph.neighbour.data(), block.data(), diagonal.data(), state.u.data(), out);
}

void Blocks::touched_matrix(RingState& s, double* A) const {
    const size_t n = 3 * size_t(s.count);
    std::fill_n(A, n * n, 0.0);
    for (int at = 0; at < s.count; at++) {
        const int i = s.touched[at];
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) A[(3 * at + a) * n + 3 * at + b] = diagonal[9 * size_t(i) + 3 * a + b];
        for (int e = graph.start[i]; e < graph.start[i + 1]; e++) {
            const int other = s.place[graph.neighbour[e]];
            if (other < 0) continue;
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) A[(3 * at + a) * n + 3 * other + b] = block[12 * size_t(e) + 4 * b + a];
        }
    }
}

void Blocks::touched_right(RingState& s) const {
    for (int at = 0; at < s.count; at++) {
        const int i = s.touched[at];
        double g[4] = {0, 0, 0, 0};
        for (int e = graph.start[i]; e < graph.start[i + 1]; e++)
            if (s.place[graph.neighbour[e]] < 0) gather(block.data(), graph.neighbour.data(), s.u.data(), e, e + 1, g);
        for (int k = 0; k < 3; k++) s.right[3 * at + k] = -g[k];
    }
}

void Blocks::relax(RingState& s, int first) const {
    sweep(s.rings.order.data() + first, nodes() - first, held.data(), graph.start.data(), graph.neighbour.data(),
          block.data(), inverse.data(), relaxation, s.u.data());
}

void Blocks::bind(RingState& s) const {
    if (!modes.empty()) modes.bind(s.touched.data(), s.count, s.weight.data(), s.contacts, s.bound);
}

void Blocks::settle(RingState& s) const {
    if (!modes.empty()) modes.settle(s.bound, s.u.data());
}

double Blocks::weighed(const RingState&, int i, const double r[3]) const {
    const double* m = &inverse[9 * size_t(i)];
    double sum = 0;
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) sum += r[a] * m[3 * a + b] * r[b];
    return sum;
}

} // namespace palpate
