#include "compliance/greens_functions.h"
#include "base/cpu_dispatch.h"
#include <algorithm>
#include <limits>
#include <new>
#include <utility>

namespace palpate {
namespace {

constexpr int batch_reads = 32; // blocks whose cache misses overlap
constexpr double no_table = -1; // mm; a table of reach 0 holds the vertex itself

// out += a x + b y + c z. Numerical kernel.
PALPATE_KERNEL void add_columns(const float* x, const float* y, const float* z, float a, float b, float c, int64_t n,
                                float* __restrict out) {
    for (int64_t i = 0; i < n; i++) out[i] += a * x[i] + (b * y[i] + c * z[i]);
}

} // namespace

GreensFunctions::GreensFunctions(const FactoredStiffness& s, size_t budget)
    : stiffness(s), budget(budget), table(s.vertices()), table_reach(s.vertices(), no_table), column(s.vertices()),
      last_used(s.vertices(), 0), half_solves(s), partial(*s.tree, s.rounded.data(), 3 * batch), tree(*s.tree),
      full(tree, 1), mark(tree.count(), 0) {
    std::vector<int> places;
    for (int p : s.vertex_free) places.push_back(tree.place[p]);
    tree.paths(places.data(), int(places.size()), mark, vertex_path);
}

void GreensFunctions::BlockTable::release(BlockTable* table) {
    ::operator delete(table, std::align_val_t(alignof(BlockTable)));
}

GreensFunctions::~GreensFunctions() {
    for (auto& entry : table) BlockTable::release(entry.load());
    for (auto& [old, when] : retired) BlockTable::release(old);
}

GreensFunctions::BlockTable* GreensFunctions::BlockTable::make(const std::vector<int>& nearby) {
    constexpr int last = std::numeric_limits<int>::max();
    BlockTable about{};
    about.count = int(nearby.size());
    about.lines = (about.count + line - 1) / line;
    about.index_lines = (about.lines + line - 1) / line;
    const size_t whole = (about.bytes() + sizeof(BlockTable) - 1) / sizeof(BlockTable) * sizeof(BlockTable);
    void* memory = ::operator new(whole, std::align_val_t(alignof(BlockTable)));
    BlockTable* made = new (memory) BlockTable(about);
    for (int k = 0; k < line * about.lines; k++) made->vertex()[k] = k < about.count ? nearby[k] : last;
    for (int k = 0; k < line * about.index_lines; k++) made->first()[k] = k < about.lines ? nearby[line * k] : last;
    for (int k = 0; k < about.count; k++) new (&made->block()[k]) Block{};
    return made;
}

int GreensFunctions::BlockTable::line_of(int v) const {
    int found = -1;
    for (int k = 0; k < line * index_lines; k++) found += first()[k] <= v;
    return found;
}

int GreensFunctions::BlockTable::index_in_line(int v, int in_line) const {
    const int* from = vertex() + line * in_line;
    int found = -1;
    for (int k = 0; k < line; k++) found += from[k] <= v;
    return found >= 0 && from[found] == v ? line * in_line + found : -1;
}

GreensFunctions::Block* GreensFunctions::BlockTable::find(int v) {
    const int in_line = line_of(v), at = in_line < 0 ? -1 : index_in_line(v, in_line);
    return at < 0 ? nullptr : block() + at;
}

// Unit forces along x, y, z on each vertex: three columns per vertex, the remaining ones zero.
void GreensFunctions::set_load(const int* vertices, int count) {
    load.assign(size_t(3 * count) * partial.columns, 0);
    loaded.clear();
    for (int i = 0; i < count; i++) loaded.push_back(stiffness.vertex_free[vertices[i]]);
    for (int i = 0; i < 3 * count; i++) load[size_t(i) * partial.columns + i] = 1;
}

void GreensFunctions::compute_blocks(const int* vertices, int count, double reach) {
    for (int i = 0; i < count; i++) make_table(vertices[i], reach);
    find_pairs(vertices, count);
    compute_half_solves(vertices, count);
    for (const Pair& pair : pairs) {
        if (pair.block->known.load(std::memory_order_relaxed)) continue; // both vertices are in this batch
        half_solves.block(std::max(pair.vertex, pair.other), std::min(pair.vertex, pair.other), pair.block->value);
        pair.block->known.store(1, std::memory_order_release);
    }
    blocks_computed += count;
    trim_half_solves();
    evict();
}

// A new table of a vertex's blocks within `reach` mm; takes over the known blocks of the old one.
void GreensFunctions::make_table(int vertex, double reach) {
    nearby.clear();
    for (int v = vertex; v < stiffness.vertices(); v++)
        if (stiffness.distance(v, vertex) <= reach) nearby.push_back(v);
    BlockTable* made = BlockTable::make(nearby);
    const BlockTable* old = table[vertex].load(std::memory_order_relaxed);
    for (int k = 0; old && k < old->count; k++)
        if (old->block()[k].known.load(std::memory_order_relaxed))
            if (Block* same = made->find(old->vertex()[k])) {
                std::copy_n(old->block()[k].value, 9, same->value);
                same->known.store(1, std::memory_order_relaxed);
            }
    drop_table(vertex);
    bytes += made->bytes();
    table[vertex].store(made);
    table_reach[vertex] = reach;
    last_used[vertex] = use_count;
}

// All pairs of these vertices with vertices that have a table, whose block has a place there and is not known.
void GreensFunctions::find_pairs(const int* vertices, int count) {
    pairs.clear();
    for (int v = 0; v < stiffness.vertices(); v++) {
        if (table_reach[v] == no_table) continue;
        for (int i = 0; i < count; i++) {
            const int low = std::min(v, vertices[i]), high = std::max(v, vertices[i]);
            if (stiffness.distance(v, vertices[i]) > table_reach[low]) continue;
            Block* block = table[low].load(std::memory_order_relaxed)->find(high);
            if (!block->known.load(std::memory_order_relaxed)) pairs.push_back({vertices[i], v, block});
        }
    }
}

// The half solves of these vertices and of all that they form pairs with.
void GreensFunctions::compute_half_solves(const int* vertices, int count) {
    missing.clear();
    for (int i = 0; i < count; i++)
        if (!half_solves.has(vertices[i])) missing.push_back(vertices[i]);
    const size_t first = missing.size();
    for (const Pair& pair : pairs)
        if (!half_solves.has(pair.other) &&
            std::find(missing.begin(), missing.begin() + first, pair.other) == missing.begin() + first &&
            (missing.size() == first || missing.back() != pair.other)) // pairs with one vertex are adjacent
            missing.push_back(pair.other);
    for (size_t k = 0; k < missing.size(); k += batch)
        half_solves.compute(&missing[k], int(std::min<size_t>(batch, missing.size() - k)));
    bytes += half_solves.bytes() - std::exchange(half_solve_bytes, half_solves.bytes());
}

// A half solve is needed until every block that has a place in its vertex's table is computed.
bool GreensFunctions::half_solve_needed(int vertex) const {
    for (int v = 0; v < stiffness.vertices(); v++)
        if (table_reach[v] == no_table && stiffness.distance(v, vertex) <= table_reach[vertex]) return true;
    return false;
}

// These vertices, the least recently used first.
std::vector<int> GreensFunctions::least_recent(const std::vector<int>& vertices) const {
    std::vector<std::pair<double, int>> order;
    for (int v : vertices) order.emplace_back(double(last_used[v]), v);
    std::sort(order.begin(), order.end());
    std::vector<int> out;
    for (const auto& [when, v] : order) out.push_back(v);
    return out;
}

// Half solves may take a quarter of the budget: evicts those that are not needed, then the least recently used.
void GreensFunctions::trim_half_solves() {
    if (half_solves.bytes() <= budget / 4) return;
    half_solves_full = false;
    std::vector<int> still_needed;
    for (int v = 0; v < stiffness.vertices(); v++) {
        if (!half_solves.has(v)) continue;
        half_solve_needed(v) ? still_needed.push_back(v) : half_solves.drop(v);
    }
    for (int v : least_recent(still_needed)) {
        if (half_solves.bytes() <= budget / 16 * 3) break; // down to 3/16, so that the next call does not search again
        half_solves.drop(v);
        half_solves_full = true;
    }
    bytes += half_solves.bytes() - std::exchange(half_solve_bytes, half_solves.bytes());
}

void GreensFunctions::compute_columns(const int* vertices, int count) {
    set_load(vertices, count);
    const int all = stiffness.vertices();
    result.resize(3 * size_t(all) * partial.columns);
    partial.solve(loaded.data(), count, load.data(), stiffness.vertex_free.data(), all, result.data(), 3 * count);
    for (int i = 0; i < count; i++) {
        drop_column(vertices[i]);
        std::unique_ptr<float[]> made(new float[9 * size_t(all)]);
        for (int b = 0; b < 3; b++)
            for (int r = 0; r < 3 * all; r++)
                made[size_t(b) * 3 * all + r] = result[size_t(r) * partial.columns + 3 * i + b];
        column[vertices[i]] = std::move(made);
        bytes += column_bytes();
        last_used[vertices[i]] = use_count;
        columns_computed++;
    }
    evict();
}

void GreensFunctions::solve(const int* vertices, int count, const double* load, float* out) {
    loaded.clear();
    for (int i = 0; i < count; i++) {
        loaded.push_back(tree.place[stiffness.vertex_free[vertices[i]]]);
        for (int k = 0; k < 3; k++) full.x[3 * size_t(loaded[i]) + k] = float(load[3 * i + k]);
    }
    tree.paths(loaded.data(), count, mark, load_path);
    full.forward(stiffness.rounded.data(), load_path.data(), int(load_path.size()));
    full.backward(stiffness.rounded.data(), vertex_path.data(), int(vertex_path.size()));
    for (int v = 0; v < stiffness.vertices(); v++)
        std::copy_n(&full.x[3 * size_t(tree.place[stiffness.vertex_free[v]])], 3, out + 3 * size_t(v));
    full.clear(vertex_path.data(), int(vertex_path.size())); // contains every path to a vertex
}

bool GreensFunctions::superpose(const int* vertices, int count, const double* load, float* out) const {
    for (int k = 0; k < count; k++)
        if (!columns(vertices[k])) return false;
    const int64_t n = 3 * int64_t(stiffness.vertices());
    std::fill_n(out, n, 0.0f);
    for (int k = 0; k < count; k++) {
        const float* x = columns(vertices[k]);
        const double* at = load + 3 * k;
        add_columns(x, x + n, x + 2 * n, float(at[0]), float(at[1]), float(at[2]), n, out);
    }
    return true;
}

void GreensFunctions::read(BlockRequest* requests, int count) const {
    for (int k = 0; k < count; k += batch_reads) read_some(requests + k, std::min(batch_reads, count - k));
}

void GreensFunctions::read_some(BlockRequest* requests, int count) const {
    const BlockTable* entry[batch_reads];
    const Block* from[batch_reads];
    int at[batch_reads];
    for (int k = 0; k < count; k++) __builtin_prefetch(&table[std::min(requests[k].i, requests[k].j)]);
    for (int k = 0; k < count; k++) {
        entry[k] = table[std::min(requests[k].i, requests[k].j)].load();
        if (entry[k]) __builtin_prefetch(entry[k]), __builtin_prefetch(entry[k]->first());
    }
    for (int k = 0; k < count; k++) {
        at[k] = entry[k] ? entry[k]->line_of(std::max(requests[k].i, requests[k].j)) : -1;
        if (at[k] >= 0) __builtin_prefetch(entry[k]->vertex() + BlockTable::line * at[k]);
    }
    for (int k = 0; k < count; k++) {
        if (at[k] >= 0) at[k] = entry[k]->index_in_line(std::max(requests[k].i, requests[k].j), at[k]);
        from[k] = at[k] < 0 ? nullptr : entry[k]->block() + at[k];
        if (from[k]) __builtin_prefetch(from[k]), __builtin_prefetch(&from[k]->known);
    }
    for (int k = 0; k < count; k++) {
        requests[k].found = from[k] && from[k]->known.load(std::memory_order_acquire);
        if (!requests[k].found) continue;
        const bool row_major = requests[k].i >= requests[k].j;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) requests[k].out[3 * r + c] = from[k]->value[row_major ? 3 * r + c : 3 * c + r];
    }
}

void GreensFunctions::mark_used(const int* vertices, int count) {
    use_count++;
    for (int i = 0; i < count; i++) last_used[vertices[i]] = use_count;
    evict();
}

void GreensFunctions::drop_table(int vertex) {
    BlockTable* old = table[vertex].exchange(nullptr);
    table_reach[vertex] = no_table;
    if (!old) return;
    bytes -= old->bytes();
    retired.push_back({old, read_epoch.load()});
    free_retired();
}

void GreensFunctions::drop_column(int vertex) {
    if (!column[vertex]) return;
    column[vertex].reset();
    bytes -= column_bytes();
}

// Frees the tables that no reader can hold: nobody is reading, or the reader has called end_read() since.
void GreensFunctions::free_retired() {
    const uint64_t at = read_epoch.load();
    auto unreachable = [&](const std::pair<BlockTable*, uint64_t>& old) {
        if (old.second % 2 == 1 && at == old.second) return false;
        BlockTable::release(old.first);
        return true;
    };
    retired.erase(std::remove_if(retired.begin(), retired.end(), unreachable), retired.end());
}

void GreensFunctions::evict() {
    if (bytes <= budget) return;
    std::vector<int> candidates;
    for (int v = 0; v < stiffness.vertices(); v++)
        if (last_used[v] < use_count && (column[v] || table[v].load())) candidates.push_back(v);
    candidates = least_recent(candidates);
    // Columns first: they serve displays, blocks serve forces.
    for (bool columns : {true, false})
        for (int v : candidates) {
            if (bytes <= budget / 8 * 7) return; // down to 7/8, so that the next call does not sort again
            if (columns ? !column[v] : !table[v].load()) continue;
            columns ? drop_column(v) : drop_table(v);
            evicted++;
        }
}

} // namespace palpate
