#include "halves.h"
#include "dispatch.h"
#include "lanes.h"
#include <algorithm>
#include <stdexcept>

namespace palpate {
namespace {

constexpr int width = Supernodes::panel;

// The products of three columns a with three b: out[3 c + d] = a_c' b_d. Numerical kernel.
PALPATE_KERNEL void multiply_columns(const float* a, int64_t a_apart, const float* b, int64_t b_apart, int64_t rows,
                                     float out[9]) {
    Lanes sum[9] = {};
    int64_t k = 0;
    for (; k + lanes <= rows; k += lanes) {
        Lanes p[3], q[3];
        PALPATE_UNROLL
        for (int c = 0; c < 3; c++) load(p[c], a + c * a_apart + k), load(q[c], b + c * b_apart + k);
        PALPATE_UNROLL
        for (int c = 0; c < 3; c++) {
            PALPATE_UNROLL
            for (int d = 0; d < 3; d++) sum[3 * c + d] += p[c] * q[d];
        }
    }
    for (int c = 0; c < 9; c++) out[c] = total(sum[c]);
    for (; k < rows; k++)
        for (int c = 0; c < 9; c++) out[c] += a[(c / 3) * a_apart + k] * b[(c % 3) * b_apart + k];
}

} // namespace

Halves::Halves(const Elastic& e)
    : elastic(e), tree(e.factor->tree), substitution(tree, 3 * batch), half(e.vertices()), rows(tree.count()),
      spots(batch), mark(tree.count(), 0) {
    path.reserve(tree.count());
    for (int s = tree.count() - 1; s >= 0; s--) // parents come later
        rows[s] = tree.own(s) + (tree.parent[s] < 0 ? 0 : rows[tree.parent[s]]);
}

void Halves::make(const int* vertices, int count) {
    if (count > batch) throw std::invalid_argument("Halves: more than a batch");
    substitution.groups = (3 * count + width - 1) / width;
    for (int i = 0; i < count; i++) {
        spots[i] = tree.place[elastic.place[vertices[i]]];
        for (int c = 0; c < 3; c++) {
            const int column = 3 * i + c;
            substitution.of(column / width, 3 * spots[i] + c)[column % width] = 1;
        }
    }
    tree.paths(spots.data(), count, mark, path);
    substitution.forward(elastic.single.data(), path.data(), int(path.size()));
    for (int i = 0; i < count; i++) {
        const int first = leaf(vertices[i]);
        drop(vertices[i]);
        half[vertices[i]].reset(new float[3 * rows[first]]);
        held += 3 * sizeof(float) * rows[first];
        float* out = half[vertices[i]].get();
        for (int column = 3 * i; column < 3 * i + 3; column++)
            for (int s = first; s >= 0; s = tree.parent[s]) {
                const float* from = substitution.of(column / width, 3 * tree.first[s]) + column % width;
                for (int k = 0; k < tree.own(s); k++) *out++ = from[width * k];
            }
    }
    substitution.clear(path.data(), int(path.size())); // it is zero between solves
}

void Halves::drop(int vertex) {
    if (!half[vertex]) return;
    half[vertex].reset();
    held -= 3 * sizeof(float) * rows[leaf(vertex)];
}

void Halves::block(int i, int j, float out[9]) const {
    const int64_t mine = rows[leaf(i)], others = rows[leaf(j)];
    int a = leaf(i), b = leaf(j);
    while (a != b && a >= 0 && b >= 0) a < b ? a = tree.parent[a] : b = tree.parent[b]; // parents have higher numbers
    const int64_t shared = a == b ? rows[a] : 0;
    multiply_columns(half[i].get() + mine - shared, mine, half[j].get() + others - shared, others, shared, out);
}

} // namespace palpate
