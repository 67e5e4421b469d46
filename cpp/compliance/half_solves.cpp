#include "compliance/half_solves.h"
#include "base/cpu_dispatch.h"
#include "base/simd.h"
#include <algorithm>
#include <stdexcept>

namespace palpate {
namespace {

constexpr int width = Supernodes::panel;

// The products of three columns a with three b: out[3 c + d] = a_c' b_d. Numerical kernel.
PALPATE_KERNEL void multiply_columns(const float* a, int64_t a_stride, const float* b, int64_t b_stride, int64_t rows,
                                     float out[9]) {
    f32x8 sum[9] = {};
    int64_t k = 0;
    for (; k + lanes <= rows; k += lanes) {
        f32x8 p[3], q[3];
        PALPATE_UNROLL
        for (int c = 0; c < 3; c++) load(p[c], a + c * a_stride + k), load(q[c], b + c * b_stride + k);
        PALPATE_UNROLL
        for (int c = 0; c < 3; c++) {
            PALPATE_UNROLL
            for (int d = 0; d < 3; d++) sum[3 * c + d] += p[c] * q[d];
        }
    }
    for (int c = 0; c < 9; c++) out[c] = total(sum[c]);
    for (; k < rows; k++)
        for (int c = 0; c < 9; c++) out[c] += a[(c / 3) * a_stride + k] * b[(c % 3) * b_stride + k];
}

} // namespace

HalfSolves::HalfSolves(const FactoredStiffness& s)
    : stiffness(s), tree(*s.tree), substitution(tree, 3 * batch), columns(s.vertices()), path_rows(tree.count()),
      places(batch), mark(tree.count(), 0) {
    path.reserve(tree.count());
    for (int k = tree.count() - 1; k >= 0; k--) // parents have higher numbers
        path_rows[k] = tree.own(k) + (tree.parent[k] < 0 ? 0 : path_rows[tree.parent[k]]);
}

void HalfSolves::compute(const int* vertices, int count) {
    if (count > batch) throw std::invalid_argument("HalfSolves: more than a batch");
    substitution.groups = (3 * count + width - 1) / width;
    for (int i = 0; i < count; i++) {
        places[i] = tree.place[stiffness.vertex_free[vertices[i]]];
        for (int c = 0; c < 3; c++) {
            const int column = 3 * i + c;
            substitution.of(column / width, 3 * places[i] + c)[column % width] = 1;
        }
    }
    tree.paths(places.data(), count, mark, path);
    substitution.forward(stiffness.rounded.data(), path.data(), int(path.size()));
    for (int i = 0; i < count; i++) {
        const int first = leaf(vertices[i]);
        drop(vertices[i]);
        columns[vertices[i]].reset(new float[3 * path_rows[first]]);
        stored_bytes += 3 * sizeof(float) * path_rows[first];
        float* out = columns[vertices[i]].get();
        for (int column = 3 * i; column < 3 * i + 3; column++)
            for (int s = first; s >= 0; s = tree.parent[s]) {
                const float* from = substitution.of(column / width, 3 * tree.first[s]) + column % width;
                for (int k = 0; k < tree.own(s); k++) *out++ = from[width * k];
            }
    }
    substitution.clear(path.data(), int(path.size())); // zero between calls
}

void HalfSolves::drop(int vertex) {
    if (!columns[vertex]) return;
    columns[vertex].reset();
    stored_bytes -= 3 * sizeof(float) * path_rows[leaf(vertex)];
}

void HalfSolves::block(int i, int j, float out[9]) const {
    const int64_t rows_i = path_rows[leaf(i)], rows_j = path_rows[leaf(j)];
    int a = leaf(i), b = leaf(j);
    while (a != b && a >= 0 && b >= 0) a < b ? a = tree.parent[a] : b = tree.parent[b]; // parents have higher numbers
    const int64_t shared = a == b ? path_rows[a] : 0;
    multiply_columns(columns[i].get() + rows_i - shared, rows_i, columns[j].get() + rows_j - shared, rows_j, shared,
                     out);
}

} // namespace palpate
