#include "green.h"
#include <algorithm>
#include <cstdlib>
#include <limits>
#include <new>
#include <utility>

namespace palpate {
namespace {

constexpr int together = 32; // blocks whose waits overlap
constexpr double none = -1;  // mm: a vertex without a table; one of reach 0 knows itself

} // namespace

Green::Green(const Elastic& e, size_t budget)
    : elastic(e), budget(budget), near(e.vertices()), reached(e.vertices(), none), column(e.vertices()),
      used(e.vertices(), 0), halves(e), partial(e.factor->tree, e.single.data(), 3 * batch), tree(e.factor->tree),
      one(tree, 1), mark(tree.count(), 0) {
    std::vector<int> places;
    for (int p : e.place) places.push_back(tree.place[p]);
    tree.paths(places.data(), int(places.size()), mark, shown);
}

Green::~Green() {
    for (auto& held : near) std::free(held.load());
    for (auto& [old, when] : retired) std::free(old);
}

Green::Near* Green::Near::make(const std::vector<int>& others) {
    constexpr int last = std::numeric_limits<int>::max();
    Near about{};
    about.count = int(others.size());
    about.lines = (about.count + line - 1) / line;
    about.groups = (about.lines + line - 1) / line;
    const size_t whole = (about.bytes() + sizeof(Near) - 1) / sizeof(Near) * sizeof(Near);
    void* memory = std::aligned_alloc(alignof(Near), whole);
    if (!memory) throw std::bad_alloc();
    Near* made = new (memory) Near(about);
    for (int k = 0; k < line * about.lines; k++) made->other()[k] = k < about.count ? others[k] : last;
    for (int k = 0; k < line * about.groups; k++) made->first()[k] = k < about.lines ? others[line * k] : last;
    for (int k = 0; k < about.count; k++) new (&made->block()[k]) Block{};
    return made;
}

int Green::Near::line_of(int vertex) const {
    int found = -1;
    for (int k = 0; k < line * groups; k++) found += first()[k] <= vertex;
    return found;
}

int Green::Near::place(int vertex, int in_line) const {
    const int* from = other() + line * in_line;
    int found = -1;
    for (int k = 0; k < line; k++) found += from[k] <= vertex;
    return found >= 0 && from[found] == vertex ? line * in_line + found : -1;
}

Green::Block* Green::Near::find(int vertex) {
    const int in_line = line_of(vertex), at = in_line < 0 ? -1 : place(vertex, in_line);
    return at < 0 ? nullptr : block() + at;
}

// Unit forces along x, y, z on each vertex: three columns a vertex, the others empty.
void Green::set_load(const int* vertices, int count) {
    load.assign(size_t(3 * count) * partial.columns, 0);
    loaded.clear();
    for (int i = 0; i < count; i++) loaded.push_back(elastic.place[vertices[i]]);
    for (int i = 0; i < 3 * count; i++) load[size_t(i) * partial.columns + i] = 1;
}

void Green::make_near(const int* vertices, int count, double reach) {
    for (int i = 0; i < count; i++) list_near(vertices[i], reach);
    find_pairs(vertices, count);
    make_halves(vertices, count);
    for (const Pair& pair : pairs) {
        if (pair.block->known.load(std::memory_order_relaxed)) continue; // two of this batch: once is enough
        halves.block(std::max(pair.of, pair.with), std::min(pair.of, pair.with), pair.block->value);
        pair.block->known.store(1, std::memory_order_release);
    }
    made_near += count;
    trim_halves();
    evict();
}

// A table of a vertex's blocks with the others within `reach` mm, of which those are known that were.
void Green::list_near(int vertex, double reach) {
    others.clear();
    for (int v = vertex; v < elastic.vertices(); v++)
        if (elastic.apart(v, vertex) <= reach) others.push_back(v);
    Near* made = Near::make(others);
    const Near* old = near[vertex].load(std::memory_order_relaxed);
    for (int k = 0; old && k < old->count; k++)
        if (old->block()[k].known.load(std::memory_order_relaxed))
            if (Block* same = made->find(old->other()[k])) {
                std::copy_n(old->block()[k].value, 9, same->value);
                same->known.store(1, std::memory_order_relaxed);
            }
    drop_near(vertex);
    bytes += made->bytes();
    near[vertex].store(made);
    reached[vertex] = reach;
    used[vertex] = now;
}

// All pairs of these with those that have a table, themselves among them, whose block has a place and is not known.
void Green::find_pairs(const int* vertices, int count) {
    pairs.clear();
    for (int v = 0; v < elastic.vertices(); v++) {
        if (reached[v] == none) continue;
        for (int i = 0; i < count; i++) {
            const int low = std::min(v, vertices[i]), high = std::max(v, vertices[i]);
            if (elastic.apart(v, vertices[i]) > reached[low]) continue;
            Block* block = near[low].load(std::memory_order_relaxed)->find(high);
            if (!block->known.load(std::memory_order_relaxed)) pairs.push_back({vertices[i], v, block});
        }
    }
}

// The halves of these and of whoever they make pairs with.
void Green::make_halves(const int* vertices, int count) {
    lacking.clear();
    for (int i = 0; i < count; i++)
        if (!halves.kept(vertices[i])) lacking.push_back(vertices[i]);
    const size_t first = lacking.size();
    for (const Pair& pair : pairs)
        if (!halves.kept(pair.with) &&
            std::find(lacking.begin(), lacking.begin() + first, pair.with) == lacking.begin() + first &&
            (lacking.size() == first || lacking.back() != pair.with)) // those with one vertex follow each other
            lacking.push_back(pair.with);
    for (size_t k = 0; k < lacking.size(); k += batch)
        halves.make(&lacking[k], int(std::min<size_t>(batch, lacking.size() - k)));
    bytes += halves.bytes() - std::exchange(counted, halves.bytes());
}

// Half a column is of use until all whose blocks with it have a place are made.
bool Green::of_use(int vertex) const {
    for (int v = 0; v < elastic.vertices(); v++)
        if (reached[v] == none && elastic.apart(v, vertex) <= reached[vertex]) return true;
    return false;
}

// Halves may take a quarter of the budget: first those of no more use go, then the least recently used.
void Green::trim_halves() {
    if (halves.bytes() <= budget / 4) return;
    crowded = false;
    std::vector<int> left;
    for (int v = 0; v < elastic.vertices(); v++) {
        if (!halves.kept(v)) continue;
        of_use(v) ? left.push_back(v) : halves.drop(v);
    }
    std::stable_sort(left.begin(), left.end(), [&](int a, int b) { return used[a] < used[b]; });
    for (int v : left) {
        if (halves.bytes() <= budget / 16 * 3) break; // some room, so that the next one does not look again
        halves.drop(v);
        crowded = true;
    }
    bytes += halves.bytes() - std::exchange(counted, halves.bytes());
}

void Green::make_columns(const int* vertices, int count) {
    set_load(vertices, count);
    const int all = elastic.vertices();
    result.resize(3 * size_t(all) * partial.columns);
    partial.solve(loaded.data(), count, load.data(), elastic.place.data(), all, result.data(), 3 * count);
    for (int i = 0; i < count; i++) {
        drop_column(vertices[i]);
        std::unique_ptr<float[]> made(new float[9 * size_t(all)]);
        for (int b = 0; b < 3; b++)
            for (int r = 0; r < 3 * all; r++)
                made[size_t(b) * 3 * all + r] = result[size_t(r) * partial.columns + 3 * i + b];
        column[vertices[i]] = std::move(made);
        bytes += column_bytes();
        used[vertices[i]] = now;
        made_columns++;
    }
    evict();
}

void Green::solve(const int* vertices, int count, const double* load, float* out) {
    loaded.clear();
    for (int i = 0; i < count; i++) {
        loaded.push_back(tree.place[elastic.place[vertices[i]]]);
        for (int k = 0; k < 3; k++) one.x[3 * size_t(loaded[i]) + k] = float(load[3 * i + k]);
    }
    tree.paths(loaded.data(), count, mark, path);
    one.forward_one(elastic.single.data(), path.data(), int(path.size()));
    one.backward_one(elastic.single.data(), shown.data(), int(shown.size()));
    for (int v = 0; v < elastic.vertices(); v++)
        std::copy_n(&one.x[3 * size_t(tree.place[elastic.place[v]])], 3, out + 3 * size_t(v));
    one.clear(shown.data(), int(shown.size())); // every path to a vertex is among them
}

void Green::find(Wanted* wanted, int count) const {
    for (int k = 0; k < count; k += together) find_some(wanted + k, std::min(together, count - k));
}

void Green::find_some(Wanted* wanted, int count) const {
    const Near* held[together];
    const Block* from[together];
    int at[together];
    for (int k = 0; k < count; k++) __builtin_prefetch(&near[std::min(wanted[k].i, wanted[k].j)]);
    for (int k = 0; k < count; k++) {
        held[k] = near[std::min(wanted[k].i, wanted[k].j)].load();
        if (held[k]) __builtin_prefetch(held[k]), __builtin_prefetch(held[k]->first());
    }
    for (int k = 0; k < count; k++) {
        at[k] = held[k] ? held[k]->line_of(std::max(wanted[k].i, wanted[k].j)) : -1;
        if (at[k] >= 0) __builtin_prefetch(held[k]->other() + Near::line * at[k]);
    }
    for (int k = 0; k < count; k++) {
        if (at[k] >= 0) at[k] = held[k]->place(std::max(wanted[k].i, wanted[k].j), at[k]);
        from[k] = at[k] < 0 ? nullptr : held[k]->block() + at[k];
        if (from[k]) __builtin_prefetch(from[k]), __builtin_prefetch(&from[k]->known);
    }
    for (int k = 0; k < count; k++) {
        wanted[k].found = from[k] && from[k]->known.load(std::memory_order_acquire);
        if (!wanted[k].found) continue;
        const bool along = wanted[k].i >= wanted[k].j;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) wanted[k].out[3 * r + c] = from[k]->value[along ? 3 * r + c : 3 * c + r];
    }
}

void Green::use(const int* vertices, int count) {
    now++;
    for (int i = 0; i < count; i++) used[vertices[i]] = now;
    evict();
}

void Green::drop_near(int vertex) {
    Near* old = near[vertex].exchange(nullptr);
    reached[vertex] = none;
    if (!old) return;
    bytes -= old->bytes();
    retired.push_back({old, epoch.load()});
    sweep_retired();
}

void Green::drop_column(int vertex) {
    if (!column[vertex]) return;
    column[vertex].reset();
    bytes -= column_bytes();
}

// Frees what no reader can hold any more: none reads now, or the one who did has closed since.
void Green::sweep_retired() {
    const uint64_t at = epoch.load();
    auto gone = [&](const std::pair<Near*, uint64_t>& old) {
        if (old.second % 2 == 1 && at == old.second) return false;
        std::free(old.first);
        return true;
    };
    retired.erase(std::remove_if(retired.begin(), retired.end(), gone), retired.end());
}

void Green::evict() {
    if (bytes <= budget) return;
    std::vector<int> candidates;
    for (int v = 0; v < elastic.vertices(); v++)
        if (used[v] < now && (column[v] || near[v].load())) candidates.push_back(v);
    std::stable_sort(candidates.begin(), candidates.end(), [&](int a, int b) { return used[a] < used[b]; });
    // Columns first: a display can wait, a hand cannot.
    for (bool columns : {true, false})
        for (int v : candidates) {
            if (bytes <= budget / 8 * 7) return; // some room, so that the next one does not sort again
            if (columns ? !column[v] : !near[v].load()) continue;
            columns ? drop_column(v) : drop_near(v);
            evicted++;
        }
}

} // namespace palpate
