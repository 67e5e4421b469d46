#pragma once
#include "multigrid.h"

namespace palpate {

// What the files of the multigrid model share.

constexpr int most_columns = 3 * Multigrid::most_contacts;
constexpr int most_span = 1 + MultigridState::history + most_columns;

inline Column column(const Field& f) { return {f.data(), nullptr}; }
inline Column column(const Buffer& f) { return {nullptr, f.data()}; }

// A combination of the span; the first of its fields, u, is not listed. Room for one more.
struct Multigrid::Start {
    int count, slot[most_span];
    const float *field[1 + most_span], *image[most_span];
    double coefficient[1 + most_span], f[most_columns];
};

// The mesh, its nodes in the order of the sweeps.
struct Multigrid::Ordered {
    std::vector<int> order, inside; // the caller's number of each node, and back
    std::vector<double> node;
    std::vector<int32_t> tet;
    std::vector<uint8_t> held;
    Elements mesh;
    explicit Ordered(const Elements& given);
};

} // namespace palpate
