#include "green.h"
#include <algorithm>
#include <cmath>

namespace palpate {

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
    for (auto& held : near) delete held.load();
    for (auto& [old, when] : retired) delete old;
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
        auto made = std::make_unique<Near>();
        for (size_t k = 0; k < others.size(); k++) {
            if (elastic.apart(others[k], vertices[i]) > reach) continue;
            made->other.push_back(others[k]);
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) made->block.push_back(result[(3 * k + a) * partial.columns + 3 * i + b]);
        }
        drop_near(vertices[i]);
        bytes += made->bytes();
        near[vertices[i]].store(made.release());
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

bool Green::block(int i, int j, float out[9]) const {
    // Always from the lower one's columns: its transpose from the other's would differ in the last bits, and the answer
    // must not depend on which was made first.
    const int of = std::min(i, j), with = std::max(i, j);
    const Near* held = near[of].load();
    if (!held) return false;
    const auto at = std::lower_bound(held->other.begin(), held->other.end(), with);
    if (at == held->other.end() || *at != with) return false;
    const float* b = &held->block[9 * (at - held->other.begin())]; // displacement of `with`, force on `of`
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) out[3 * r + c] = i == with ? b[3 * r + c] : b[3 * c + r];
    return true;
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
        delete old.first;
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
