#include "compliance/patch_blocks.h"
#include "base/cpu_dispatch.h"
#include <algorithm>
#include <stdexcept>

namespace palpate {
namespace {

constexpr int capacity = ContactPatch::capacity;

size_t row_start(int i) { return size_t(i) * (i + 1) / 2; } // of the pairs

// Numerical kernel.
PALPATE_KERNEL void weighted_sum(const float* block, const double* weight, int count, double out[9]) {
    double half[9] = {};
    for (int i = 0; i < count; i++) {
        double row[9] = {};
        for (int j = 0; j <= i; j++, block += 9) {
            const double w = j < i ? weight[j] : 0.5 * weight[j];
            for (int k = 0; k < 9; k++) row[k] += w * block[k];
        }
        for (int k = 0; k < 9; k++) half[k] += weight[i] * row[k];
    }
    for (int k = 0; k < 9; k++) out[k] = half[k] + half[3 * (k % 3) + k / 3];
}

// Numerical kernel.
PALPATE_KERNEL void weighted_sum(const float* block, const double* v, const double* w, int count, double out[9]) {
    double sum[9] = {};
    for (int i = 0; i < count; i++)
        for (int j = 0; j <= i; j++, block += 9) {
            const double lower = v[i] * w[j], upper = j < i ? v[j] * w[i] : 0;
            if (lower == 0 && upper == 0) continue;
            for (int k = 0; k < 9; k++) sum[k] += lower * block[k] + upper * block[3 * (k % 3) + k / 3];
        }
    for (int k = 0; k < 9; k++) out[k] = sum[k];
}

// Numerical kernel. out must be zero.
PALPATE_KERNEL void multiply(const float* block, const double* load, int count, double* out) {
    for (int i = 0; i < count; i++)
        for (int j = 0; j <= i; j++, block += 9)
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++) {
                    out[3 * i + r] += block[3 * r + c] * load[3 * j + c];
                    if (j < i) out[3 * j + c] += block[3 * r + c] * load[3 * i + r];
                }
}

} // namespace

bool PatchVertices::gather(const FactoredStiffness& stiffness, const ContactPatch* patches, int patch_count) {
    entries = count = 0;
    for (int p = 0; p < patch_count; p++)
        for (int k = 0; k < patches[p].count; k++) {
            const int v = stiffness.vertex_index[patches[p].node[k]];
            if (v < 0) throw std::invalid_argument("patch: a node that is not a free vertex");
            int to = entries++; // insertion sort: patches are small and nearly in order
            for (; to > 0 && vertex[to - 1] > v; to--) vertex[to] = vertex[to - 1], source[to] = source[to - 1];
            vertex[to] = v, source[to] = p * capacity + k;
        }
    for (int k = 0; k < entries; k++) {
        if (k == 0 || vertex[k] != vertex[count - 1]) vertex[count++] = vertex[k];
        index[k] = count - 1;
    }
    return count <= capacity;
}

PatchBlocks::PatchBlocks() : vertex(capacity), block(9 * row_start(capacity)), known(row_start(capacity)) {}

void PatchBlocks::carry_over(const PatchBlocks& old, const int* vertices, int n) {
    count = n;
    std::copy_n(vertices, count, vertex.begin());
    // Runs of vertices that are adjacent in both: their blocks are copied together.
    struct Run {
        int first, count, from;
    } runs[capacity];
    int run_count = 0, next = 0;
    for (int i = 0; i < count; i++) {
        while (next < old.count && old.vertex[next] < vertices[i]) next++;
        if (next == old.count || old.vertex[next] != vertices[i]) continue;
        Run& last = runs[std::max(run_count - 1, 0)];
        if (run_count > 0 && last.first + last.count == i && last.from + last.count == next)
            last.count++;
        else
            runs[run_count++] = {i, 1, next};
    }
    const size_t pairs = row_start(count);
    for (size_t k = 0; k < 9 * pairs; k += 16) __builtin_prefetch(&block[k], 1);
    std::fill_n(known.begin(), pairs, uint8_t(0));
    for (int r = 0; r < run_count; r++)
        for (int k = 0; k < runs[r].count; k++)
            for (int q = 0; q <= r; q++) {
                const size_t to = row_start(runs[r].first + k) + runs[q].first;
                const size_t from = row_start(runs[r].from + k) + runs[q].from;
                const int copied = q < r ? runs[q].count : k + 1;
                std::copy_n(&old.known[from], copied, &known[to]);
                std::copy_n(&old.block[9 * from], 9 * copied, &block[9 * to]);
            }
    missing = int(std::count(known.begin(), known.begin() + pairs, uint8_t(0)));
    checked = -1;
}

void PatchBlocks::fetch(GreensFunctions& greens) {
    const int64_t computed = greens.blocks_computed;
    if (missing == 0 || computed == checked) return;
    checked = computed;
    constexpr int batch = 64; // small, so that the stack stays on few pages
    GreensFunctions::BlockRequest request[batch];
    uint8_t* flag[batch];
    size_t pair = 0;
    int waiting = 0;
    auto read = [&] {
        greens.read(request, waiting);
        for (int k = 0; k < waiting; k++)
            if (request[k].found) *flag[k] = 1, missing--;
        waiting = 0;
    };
    greens.begin_read();
    for (int i = 0; i < count; i++)
        for (int j = 0; j <= i; j++, pair++) {
            if (known[pair]) continue;
            flag[waiting] = &known[pair];
            request[waiting++] = {vertex[i], vertex[j], &block[9 * pair], false};
            if (waiting == batch) read();
        }
    read();
    greens.end_read();
}

void PatchBlocks::compliance(const double* w, double out[9]) const { weighted_sum(block.data(), w, count, out); }

void PatchBlocks::compliance(const double* v, const double* w, double out[9]) const {
    weighted_sum(block.data(), v, w, count, out);
}

void PatchBlocks::apply(const double* load, double* out) const {
    std::fill_n(out, 3 * count, 0.0);
    multiply(block.data(), load, count, out);
}

} // namespace palpate
