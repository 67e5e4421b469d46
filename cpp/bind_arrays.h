#pragma once
#include <nanobind/ndarray.h>
#include <vector>

// Vectors as numpy arrays that own what they show, without a copy.

template <class T> struct OneColumn { // of one dimension
    static nanobind::ndarray<nanobind::numpy, T, nanobind::ndim<1>> from(std::vector<T> values) {
        auto* kept = new std::vector<T>(std::move(values));
        nanobind::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
        return {kept->data(), {kept->size()}, owner};
    }
};

// (n, 3)
template <class T> nanobind::ndarray<nanobind::numpy, T, nanobind::ndim<2>> rows(std::vector<T> values) {
    auto* kept = new std::vector<T>(std::move(values));
    nanobind::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
    return {kept->data(), {kept->size() / 3, 3}, owner};
}
