#include "green.h"
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <new>

namespace palpate {
namespace {

constexpr int together = 32; // blocks whose waits overlap

} // namespace

double Elastic::apart(int a, int b) const {
    double sum = 0;
    for (int k = 0; k < 3; k++) {
        const double d = position[3 * size_t(a) + k] - position[3 * size_t(b) + k];
        sum += d * d;
    }
    return std::sqrt(sum);
}

Green::Green(const Elastic& e, size_t budget)
    : elastic(e), budget(budget), near(e.vertices()), reached(e.vertices(), 0), column(e.vertices()),
      used(e.vertices(), 0), partial(e.factor->tree, e.single.data(), 3 * batch),
      one(e.factor->tree, e.single.data(), Supernodes::panel) {}

Green::~Green() {
    for (auto& held : near) std::free(const_cast<Near*>(held.load()));
    for (auto& [old, when] : retired) std::free(const_cast<Near*>(old));
}

Green::Near* Green::Near::make(int count) {
    Near about{};
    about.count = count;
    about.lines = (count + line - 1) / line;
    about.groups = (about.lines + line - 1) / line;
    const size_t whole = (about.bytes() + sizeof(Near) - 1) / sizeof(Near) * sizeof(Near);
    void* memory = std::aligned_alloc(alignof(Near), whole);
    if (!memory) throw std::bad_alloc();
    return new (memory) Near(about);
}

void Green::Near::list(const int* others) {
    constexpr int none = std::numeric_limits<int>::max();
    for (int k = 0; k < line * lines; k++) other()[k] = k < count ? others[k] : none;
    for (int k = 0; k < line * groups; k++) first()[k] = k < lines ? others[line * k] : none;
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

// Unit forces along x, y, z on each vertex: three columns a vertex, the others empty.
void Green::set_load(const int* vertices, int count) {
    load.assign(size_t(3 * count) * partial.columns, 0);
    loaded.clear();
    for (int i = 0; i < count; i++) loaded.push_back(elastic.place[vertices[i]]);
    for (int i = 0; i < 3 * count; i++) load[size_t(i) * partial.columns + i] = 1;
}

void Green::make_near(const int* vertices, int count, double reach) {
    set_load(vertices, count);
    others.clear();
    wanted.clear();
    for (int v = 0; v < elastic.vertices(); v++) {
        bool wants = false;
        for (int i = 0; i < count && !wants; i++) wants = elastic.apart(v, vertices[i]) <= reach;
        if (wants) others.push_back(v), wanted.push_back(elastic.place[v]);
    }
    result.resize(3 * wanted.size() * partial.columns);
    partial.solve(loaded.data(), count, load.data(), wanted.data(), int(wanted.size()), result.data(), 3 * count);
    for (int i = 0; i < count; i++) {
        mine.clear();
        for (size_t k = 0; k < others.size(); k++)
            if (elastic.apart(others[k], vertices[i]) <= reach) mine.push_back(int(k));
        Near* made = Near::make(int(mine.size()));
        float* block = made->block();
        for (int k : mine)
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++)
                    *block++ = result[(3 * size_t(k) + a) * partial.columns + 3 * size_t(i) + b];
        for (int& k : mine) k = others[k];
        made->list(mine.data());
        drop_near(vertices[i]);
        bytes += made->bytes();
        near[vertices[i]].store(made);
        reached[vertices[i]] = reach;
        used[vertices[i]] = now;
        made_near++;
    }
    evict();
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

void Green::solve(const int* vertices, int count, const double* loads, float* out) {
    load.assign(size_t(3 * count) * one.columns, 0);
    loaded.clear();
    for (int i = 0; i < count; i++) {
        loaded.push_back(elastic.place[vertices[i]]);
        for (int k = 0; k < 3; k++) load[size_t(3 * i + k) * one.columns] = float(loads[3 * i + k]);
    }
    const int all = elastic.vertices();
    result.resize(3 * size_t(all) * one.columns);
    one.solve(loaded.data(), count, load.data(), elastic.place.data(), all, result.data(), 1);
    for (int r = 0; r < 3 * all; r++) out[r] = result[size_t(r) * one.columns];
}

void Green::find(Wanted* wanted, int count) const {
    for (int k = 0; k < count; k += together) find_some(wanted + k, std::min(together, count - k));
}

// Always from the lower one's columns: its transpose from the other's would differ in the last bits, and the answer
// must not depend on which was made first.
void Green::find_some(Wanted* wanted, int count) const {
    const Near* held[together];
    const float* from[together];
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
        from[k] = at[k] < 0 ? nullptr : held[k]->block() + 9 * at[k]; // displacement of that, force on the other
        if (from[k]) __builtin_prefetch(from[k]), __builtin_prefetch(from[k] + 8);
    }
    for (int k = 0; k < count; k++) {
        wanted[k].found = from[k];
        if (!from[k]) continue;
        const bool along = wanted[k].i >= wanted[k].j;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) wanted[k].out[3 * r + c] = from[k][along ? 3 * r + c : 3 * c + r];
    }
}

void Green::use(const int* vertices, int count) {
    now++;
    for (int i = 0; i < count; i++) used[vertices[i]] = now;
    evict();
}

void Green::drop_near(int vertex) {
    const Near* old = near[vertex].exchange(nullptr);
    reached[vertex] = 0;
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
    auto gone = [&](const std::pair<const Near*, uint64_t>& old) {
        if (old.second % 2 == 1 && at == old.second) return false;
        std::free(const_cast<Near*>(old.first));
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
