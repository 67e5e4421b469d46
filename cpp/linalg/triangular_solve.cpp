#include "linalg/triangular_solve.h"
#include "linalg/triangular_solve_kernels.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr int width = Supernodes::panel, tile = width * width;

int widest(const Supernodes& tree, int (Supernodes::*panels)(int) const) {
    int most = 1;
    for (int s = 0; s < tree.count(); s++) most = std::max(most, (tree.*panels)(s));
    return width * most;
}

} // namespace

template <class T>
TriangularSolve<T>::TriangularSolve(const Supernodes& tree, int columns)
    : groups(columns / width), tree(tree), columns(columns), stride(3 * tree.nodes() + 1) {
    x.assign(size_t(stride) * columns + width, 0);
    own.resize(size_t(widest(tree, &Supernodes::own_panels)) * std::max(columns, 1));
    // One column: the partial sums of the way back lie behind the gathered rows.
    below.resize(size_t(widest(tree, &Supernodes::below_panels)) * std::max(columns, 1) +
                 (columns == 1 ? width * own.size() : 0));
}

template <class T> Triangle TriangularSolve<T>::gather(int s) {
    const int size = tree.own(s);
    const Triangle n{tree.own_panels(s), tree.below_panels(s)};
    const int* index = tree.index.data() + tree.index_start[s];
    const int64_t mine = int64_t(tile) * n.own, others = int64_t(tile) * n.below;
    for (int g = 0; g < groups; g++) {
        std::copy_n(of(g, 3 * tree.first[s]), width * size, own.data() + g * mine);
        std::fill(own.data() + g * mine + width * size, own.data() + (g + 1) * mine, T(0));
        for (int i = 0; i < width * n.below; i++)
            std::copy_n(of(g, index[i]), width, below.data() + g * others + width * i);
    }
    return n;
}

template <class T> Triangle TriangularSolve<T>::gather_one(int s) {
    const int size = tree.own(s);
    const Triangle n{tree.own_panels(s), tree.below_panels(s)};
    const int* index = tree.index.data() + tree.index_start[s];
    std::copy_n(&x[3 * tree.first[s]], size, own.data());
    std::fill_n(own.data() + size, width * n.own - size, T(0));
    for (int i = 0; i < width * n.below; i++) below[i] = x[index[i]];
    return n;
}

template <class T> void TriangularSolve<T>::forward(const T* value, const int* list, int count) {
    for (int l = 0; l < count; l++) {
        const int s = list[l];
        const Triangle n = gather(s);
        const int* index = tree.index.data() + tree.index_start[s];
        palpate::forward(value + tree.entry_start[s], n, groups, own.data(), below.data());
        for (int g = 0; g < groups; g++) {
            std::copy_n(own.data() + g * int64_t(tile) * n.own, width * tree.own(s), of(g, 3 * tree.first[s]));
            for (int i = 0; i < width * n.below; i++)
                std::copy_n(below.data() + g * int64_t(tile) * n.below + width * i, width, of(g, index[i]));
        }
    }
}

template <class T> void TriangularSolve<T>::backward(const T* value, const int* list, int count) {
    for (int l = count - 1; l >= 0; l--) {
        const int s = list[l];
        const Triangle n = gather(s);
        palpate::backward(value + tree.entry_start[s], n, groups, own.data(), below.data());
        for (int g = 0; g < groups; g++)
            std::copy_n(own.data() + g * int64_t(tile) * n.own, width * tree.own(s), of(g, 3 * tree.first[s]));
    }
}

template <class T> void TriangularSolve<T>::forward_one(const T* value, const int* list, int count) {
    for (int l = 0; l < count; l++) {
        const int s = list[l];
        const Triangle n = gather_one(s);
        const int* index = tree.index.data() + tree.index_start[s];
        palpate::forward_one(value + tree.entry_start[s], n, own.data(), below.data());
        std::copy_n(own.data(), tree.own(s), &x[3 * tree.first[s]]);
        for (int i = 0; i < width * n.below; i++) x[index[i]] = below[i];
    }
}

template <class T> void TriangularSolve<T>::backward_one(const T* value, const int* list, int count) {
    T* sums = below.data() + (below.size() - width * own.size());
    for (int l = count - 1; l >= 0; l--) {
        const int s = list[l];
        const Triangle n = gather_one(s);
        palpate::backward_one(value + tree.entry_start[s], n, own.data(), below.data(), sums);
        std::copy_n(own.data(), tree.own(s), &x[3 * tree.first[s]]);
    }
}

template <class T> void TriangularSolve<T>::clear(const int* list, int count) {
    const int wide = columns == 1 ? 1 : width, all = columns == 1 ? 1 : groups;
    for (int l = 0; l < count; l++)
        for (int g = 0; g < all; g++)
            std::fill_n(&x[wide * (size_t(g) * stride + 3 * size_t(tree.first[list[l]]))], wide * tree.own(list[l]),
                        T(0));
}

template class TriangularSolve<float>;
template class TriangularSolve<double>;

} // namespace palpate
