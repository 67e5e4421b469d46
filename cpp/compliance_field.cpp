#include "ahead.h"
#include "compliance.h"
#include "dispatch.h"
#include <algorithm>

// How the whole body moves, for displays: a tick knows its patch only.
namespace palpate {
namespace {

// out += a x + b y + c z. Numerical kernel.
PALPATE_KERNEL void add_columns(const float* x, const float* y, const float* z, float a, float b, float c, int64_t n,
                                float* __restrict out) {
    for (int64_t i = 0; i < n; i++) out[i] += a * x[i] + (b * y[i] + c * z[i]);
}

} // namespace

bool Compliance::contract(const Green& green, const Touch& touch, int vertices, float* out) {
    for (int k = 0; k < touch.count; k++)
        if (!green.columns(touch.vertex[k])) return false;
    const int64_t n = 3 * int64_t(vertices);
    std::fill_n(out, n, 0.0f);
    for (int k = 0; k < touch.count; k++) {
        const float* column = green.columns(touch.vertex[k]);
        const double* load = touch.load + 3 * k;
        add_columns(column, column + n, column + 2 * n, float(load[0]), float(load[1]), float(load[2]), n, out);
    }
    return true;
}

void Compliance::show(State& state, const int* nodes, int count, float* out) const {
    auto& s = static_cast<ComplianceState&>(state);
    const float* field = s.field.data();
    if (s.tables == Tables::ahead && s.ahead)
        field = s.ahead->newest_field();
    else if (s.touch.count == 0)
        std::fill(s.field.begin(), s.field.end(), 0.0f);
    else if (!contract(s.green, s.touch, elastic.vertices(), s.field.data()))
        s.green.solve(s.touch.vertex, s.touch.count, s.touch.load, s.field.data());
    for (int i = 0; i < count; i++) {
        const int v = elastic.vertex[nodes[i]];
        for (int k = 0; k < 3; k++) out[3 * i + k] = v < 0 ? 0 : field[3 * size_t(v) + k];
    }
}

void Compliance::displacement(State& state, double* out) const {
    auto& s = static_cast<ComplianceState&>(state);
    std::vector<double> x(3 * size_t(elastic.factor->tree.nodes()), 0);
    for (int k = 0; k < s.touch.count; k++)
        for (int c = 0; c < 3; c++) x[3 * size_t(elastic.place[s.touch.vertex[k]]) + c] = s.touch.load[3 * k + c];
    elastic.factor->solve(x.data(), 1);
    for (int i = 0; i < nodes(); i++)
        for (int c = 0; c < 3; c++)
            out[3 * size_t(i) + c] = elastic.free[i] < 0 ? 0 : x[3 * size_t(elastic.free[i]) + c];
}

} // namespace palpate
