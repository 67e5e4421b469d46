#include "linalg/supernodes.h"
#include <algorithm>

namespace palpate {

Supernodes::Supernodes(const SparsityPattern& pattern, Dissection dissection)
    : order(std::move(dissection.order)), place(order.size()), first(std::move(dissection.first)), part(order.size()),
      parent(first.size() - 1, -1), row_start{0}, index_start{0}, entry_start{0} {
    for (int at = 0; at < nodes(); at++) place[order[at]] = at;
    for (int s = 0; s < count(); s++) std::fill(part.begin() + first[s], part.begin() + first[s + 1], s);
    std::vector<std::vector<int>> children(count());
    std::vector<int> seen(nodes(), -1);
    for (int s = 0; s < count(); s++) {
        const size_t begin = row.size();
        auto meet = [&](int at) {
            if (at < first[s + 1] || seen[at] == s) return;
            seen[at] = s;
            row.push_back(at);
        };
        for (int at = first[s]; at < first[s + 1]; at++)
            for (int k = pattern.start[order[at]]; k < pattern.start[order[at] + 1]; k++)
                meet(place[pattern.column[k]]);
        for (int child : children[s])
            for (int64_t k = row_start[child]; k < row_start[child + 1]; k++) meet(row[k]);
        std::sort(row.begin() + begin, row.end());
        row_start.push_back(int64_t(row.size()));
        if (row.size() > begin) {
            parent[s] = part[row[begin]];
            children[parent[s]].push_back(s);
        }
        for (size_t k = begin; k < row.size(); k++)
            for (int c = 0; c < 3; c++) index.push_back(3 * row[k] + c);
        index.resize(size_t(index_start[s]) + size_t(panel) * below_panels(s), 3 * nodes());
        index_start.push_back(int64_t(index.size()));
        entry_start.push_back(entry_start[s] + entries(s));
    }
}

double Supernodes::work(int s) const {
    const double w = own(s), r = below(s);
    return w * w * w / 3 + w * w * r + w * r * r;
}

int64_t Supernodes::entries(int s) const {
    const int64_t m = own_panels(s);
    return panel * panel * (m * (m + 1) / 2 + m * below_panels(s));
}

void Supernodes::paths(const int* places, int size, std::vector<uint8_t>& mark, std::vector<int>& out) const {
    out.clear();
    for (int k = 0; k < size; k++)
        for (int s = part[places[k]]; s >= 0 && !mark[s]; s = parent[s]) {
            mark[s] = 1;
            out.push_back(s);
        }
    std::sort(out.begin(), out.end());
    for (int s : out) mark[s] = 0;
}

} // namespace palpate
