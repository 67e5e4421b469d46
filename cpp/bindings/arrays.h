#pragma once
// Vectors of three, and new numpy arrays that own their memory. For the other files of this folder, with the
// interpreter's lock held.
#include "bindings/module.h"
#include <algorithm>
#include <array>
#include <limits>
#include <new>
#include <vector>

using Vector3 = std::array<double, 3>;

inline Vector3 vector(const double v[3]) { return {v[0], v[1], v[2]}; }

template <class T, int rank> using Owned = nb::ndarray<nb::numpy, T, nb::ndim<rank>, nb::c_contig>;

// A product of sizes that would wrap asks for more memory than there is.
inline size_t times(size_t a, size_t b) {
    if (b > 0 && a > std::numeric_limits<ptrdiff_t>::max() / b) throw std::bad_array_new_length();
    return a * b;
}

// The caller writes every element.
template <class T, class... Sizes> Owned<T, sizeof...(Sizes)> uninitialized(Sizes... shape) {
    size_t count = 1;
    ((count = times(count, size_t(shape))), ...);
    T* data = new T[count];
    return {data, {size_t(shape)...}, nb::capsule(data, [](void* p) noexcept { delete[] static_cast<T*>(p); })};
}

// The memory of a vector of as many elements, without a copy.
template <class T, class... Sizes> Owned<T, sizeof...(Sizes)> adopted(std::vector<T>&& from, Sizes... shape) {
    auto* kept = new std::vector<T>(std::move(from));
    return {kept->data(), {size_t(shape)...}, nb::capsule(kept, [](void* p) noexcept {
                delete static_cast<std::vector<T>*>(p);
            })};
}

template <class T, class... Sizes> Owned<T, sizeof...(Sizes)> zeros(Sizes... shape) {
    auto out = uninitialized<T>(shape...);
    std::fill_n(out.data(), (size_t(1) * ... * size_t(shape)), T());
    return out;
}

template <class T> Owned<T, 1> copied(const T* from, size_t n) {
    auto out = uninitialized<T>(n);
    std::copy_n(from, n, out.data());
    return out;
}

template <class T> Owned<T, 1> copied(const std::vector<T>& from) { return copied(from.data(), from.size()); }

// (n, 3)
template <class T> Owned<T, 2> rows(const std::vector<T>& from) {
    auto out = uninitialized<T>(from.size() / 3, 3);
    std::copy(from.begin(), from.end(), out.data());
    return out;
}
