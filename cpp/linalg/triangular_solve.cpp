#include "linalg/triangular_solve.h"
#include "linalg/triangular_solve_kernels.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr int width = Supernodes::panel;

int widest(const Supernodes& tree, int (Supernodes::*panels)(int) const) {
    int most = 1;
    for (int s = 0; s < tree.count(); s++) most = std::max(most, (tree.*panels)(s));
    return width * most;
}

} // namespace

template <class T>
TriangularSolve<T>::TriangularSolve(const Supernodes& tree, int columns)
    : groups(std::max(1, columns / width)), tree(tree), columns(columns), stride(3 * tree.nodes() + 1) {
    x.assign(size_t(stride) * columns + width, 0);
    own.resize(size_t(widest(tree, &Supernodes::own_panels)) * columns);
    below.resize(size_t(widest(tree, &Supernodes::below_panels)) * columns);
    if (columns == 1) sums.resize(width * own.size());
}

template <class T> template <int wide> Triangle TriangularSolve<T>::gather(int s) {
    const int size = wide * tree.own(s);
    const Triangle n{tree.own_panels(s), tree.below_panels(s)};
    const int* index = tree.index.data() + tree.index_start[s];
    const int64_t mine = int64_t(wide) * width * n.own, others = int64_t(wide) * width * n.below;
    for (int g = 0; g < groups; g++) {
        std::copy_n(place<wide>(g, 3 * tree.first[s]), size, own.data() + g * mine);
        std::fill(own.data() + g * mine + size, own.data() + (g + 1) * mine, T(0));
        const T* from = place<wide>(g, 0);
        T* to = below.data() + g * others;
        for (int i = 0; i < width * n.below; i++)
            for (int k = 0; k < wide; k++) to[wide * i + k] = from[wide * index[i] + k];
    }
    return n;
}

template <class T> template <int wide> void TriangularSolve<T>::scatter_own(int s, const Triangle& n) {
    for (int g = 0; g < groups; g++)
        std::copy_n(own.data() + g * int64_t(wide) * width * n.own, wide * tree.own(s),
                    place<wide>(g, 3 * tree.first[s]));
}

template <class T> template <int wide> void TriangularSolve<T>::go_down(const T* value, const int* list, int count) {
    for (int l = 0; l < count; l++) {
        const int s = list[l];
        const Triangle n = gather<wide>(s);
        const int* index = tree.index.data() + tree.index_start[s];
        if constexpr (wide == 1)
            forward_one(value + tree.entry_start[s], n, own.data(), below.data());
        else
            palpate::forward(value + tree.entry_start[s], n, groups, own.data(), below.data());
        scatter_own<wide>(s, n);
        for (int g = 0; g < groups; g++) {
            const T* from = below.data() + g * int64_t(wide) * width * n.below;
            T* to = place<wide>(g, 0);
            for (int i = 0; i < width * n.below; i++)
                for (int k = 0; k < wide; k++) to[wide * index[i] + k] = from[wide * i + k];
        }
    }
}

template <class T> template <int wide> void TriangularSolve<T>::go_up(const T* value, const int* list, int count) {
    for (int l = count - 1; l >= 0; l--) {
        const int s = list[l];
        const Triangle n = gather<wide>(s);
        if constexpr (wide == 1)
            backward_one(value + tree.entry_start[s], n, own.data(), below.data(), sums.data());
        else
            palpate::backward(value + tree.entry_start[s], n, groups, own.data(), below.data());
        scatter_own<wide>(s, n);
    }
}

template <class T> void TriangularSolve<T>::forward(const T* value, const int* list, int count) {
    columns == 1 ? go_down<1>(value, list, count) : go_down<width>(value, list, count);
}

template <class T> void TriangularSolve<T>::backward(const T* value, const int* list, int count) {
    columns == 1 ? go_up<1>(value, list, count) : go_up<width>(value, list, count);
}

template <class T> void TriangularSolve<T>::clear(const int* list, int count) {
    const int wide = columns == 1 ? 1 : width;
    for (int l = 0; l < count; l++)
        for (int g = 0; g < groups; g++)
            std::fill_n(&x[wide * (size_t(g) * stride + 3 * size_t(tree.first[list[l]]))], wide * tree.own(list[l]),
                        T(0));
}

template class TriangularSolve<float>;
template class TriangularSolve<double>;

} // namespace palpate
