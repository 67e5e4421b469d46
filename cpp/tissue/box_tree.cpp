#include "tissue/box_tree.h"
#include <algorithm>
#include <numeric>

namespace palpate {

void BoxTree::build(const std::vector<Bounds>& bounds, const std::vector<double>& centre) {
    const int count = int(bounds.size());
    order.resize(count);
    std::iota(order.begin(), order.end(), 0);
    box.clear();
    box.reserve(2 * bounds.size() + 1);
    if (count > 0) build(bounds, centre, 0, count);
}

int BoxTree::build(const std::vector<Bounds>& bounds, const std::vector<double>& centre, int first, int count) {
    const int index = int(box.size());
    box.push_back({});
    Box now;
    now.first = first, now.count = count;
    for (int i = first; i < first + count; i++) now.add(bounds[order[i]].low), now.add(bounds[order[i]].high);
    if (count > 4) {
        int axis = 0;
        for (int k = 1; k < 3; k++)
            if (now.high[k] - now.low[k] > now.high[axis] - now.low[axis]) axis = k;
        const auto begin = order.begin() + first;
        std::nth_element(begin, begin + count / 2, begin + count, [&](int a, int b) {
            const double x = centre[3 * size_t(a) + axis], y = centre[3 * size_t(b) + axis];
            return x < y || (x == y && a < b);
        });
        build(bounds, centre, first, count / 2);
        now.first = build(bounds, centre, first + count / 2, count - count / 2);
        now.count = 0;
    }
    box[index] = now;
    return index;
}

} // namespace palpate
