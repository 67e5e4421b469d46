#include "linalg/partial_solve.h"
#include <algorithm>

namespace palpate {
namespace {
constexpr int width = Supernodes::panel;
}

template <class T>
PartialSolve<T>::PartialSolve(const Supernodes& tree, const T* value, int columns)
    : columns(columns), tree(tree), value(value), mark(tree.count(), 0), substitution(tree, columns) {
    path.reserve(tree.count());
    needed.reserve(tree.count());
    spots.resize(tree.nodes());
}

template <class T> void PartialSolve<T>::find_paths(const int* nodes, int size, std::vector<int>& out) {
    for (int k = 0; k < size; k++) spots[k] = tree.place[nodes[k]];
    tree.paths(spots.data(), size, mark, out);
}

template <class T>
void PartialSolve<T>::solve(const int* nodes, int size, const T* load, const int* wanted, int count, T* out, int used) {
    const int groups = substitution.groups = (used + width - 1) / width;
    find_paths(wanted, count, needed);
    find_paths(nodes, size, path);
    for (int i = 0; i < 3 * size; i++)
        for (int g = 0; g < groups; g++)
            std::copy_n(load + size_t(i) * columns + width * g, width, substitution.of(g, 3 * spots[i / 3] + i % 3));
    substitution.forward(value, path.data(), int(path.size()));
    substitution.backward(value, needed.data(), int(needed.size()));
    for (int i = 0; i < 3 * count; i++)
        for (int g = 0; g < groups; g++)
            std::copy_n(substitution.of(g, 3 * tree.place[wanted[i / 3]] + i % 3), width,
                        out + size_t(i) * columns + width * g);
    substitution.clear(needed.data(), int(needed.size())); // x is zero between solves
    substitution.clear(path.data(), int(path.size()));
}

template class PartialSolve<float>;
template class PartialSolve<double>;

} // namespace palpate
