#include "partial.h"
#include <algorithm>

namespace palpate {
namespace {
constexpr int width = Supernodes::panel;
}

template <class T>
PartialSolve<T>::PartialSolve(const Supernodes& tree, const T* value, std::vector<int> nodes, int columns)
    : tree(tree), value(value), columns(columns), wanted(std::move(nodes)), mark(tree.count(), 0),
      substitution(tree, columns) {
    for (int node : wanted) spots.push_back(tree.place[node]);
    tree.paths(spots.data(), int(spots.size()), mark, needed);
    path.reserve(tree.count());
    spots.resize(tree.nodes());
}

template <class T> void PartialSolve<T>::forward(const int* nodes, int size, const T* load) {
    substitution.clear(path.data(), int(path.size()));
    for (int k = 0; k < size; k++) spots[k] = tree.place[nodes[k]];
    tree.paths(spots.data(), size, mark, path);
    for (int k = 0; k < size; k++)
        for (int c = 0; c < 3; c++)
            for (int g = 0; g < columns / width; g++)
                std::copy_n(load + size_t(3 * k + c) * columns + width * g, width,
                            substitution.of(g, 3 * spots[k] + c));
    substitution.forward(value, path.data(), int(path.size()));
}

template <class T> void PartialSolve<T>::solve(const int* nodes, int size, const T* load, T* out) {
    forward(nodes, size, load);
    substitution.backward(value, needed.data(), int(needed.size()));
    for (size_t k = 0; k < wanted.size(); k++)
        for (int c = 0; c < 3; c++)
            for (int g = 0; g < columns / width; g++)
                std::copy_n(substitution.of(g, 3 * tree.place[wanted[k]] + c), width,
                            out + (3 * k + c) * columns + width * g);
    substitution.clear(needed.data(), int(needed.size()));
}

template class PartialSolve<float>;
template class PartialSolve<double>;

} // namespace palpate
