#pragma once
#include "buffer.h"
#include <vector>

namespace palpate {

// Displacement fields and their images under K, four numbers a node. Sums run over blocks in a fixed order.
using Field = std::vector<double, CacheAligned<double>>;

// One vector of a span: in float64 or float32, the other null.
struct Column {
    const double* wide = nullptr;
    const float* narrow = nullptr;
};

// gram[a][b] = field_a . image_b for b <= a, rows of `count`. scratch: (2, count, fields_block).
constexpr int fields_block = 256;
void gram(int nodes, int count, const Column* field, const Column* image, double* scratch, double* gram);

// out = sum of coefficient_c column_c; may be one of the columns.
void combine(int nodes, int count, const Column* column, const double* coefficient, double* out);

// p = z - sum c_k Z_k + beta p, and the image likewise; returns p . image and p . force in `dots`.
void direction(int nodes, const float* z, const float* image_z, int count, const Column* Z, const Column* KZ,
               const double* c, double beta, double* p, double* image, const double* force, double dots[2]);

// (z - sum c_k Z_k) . v
double projected_dot(int nodes, const float* z, int count, const Column* Z, const double* c, const double* v);

// u += alpha p.
void step(int nodes, double alpha, const double* p, double* u);

double dot(int nodes, const double* a, const double* b);
double dot(int nodes, const float* a, const double* b);

void to_narrow(int nodes, double factor, const double* from, float* out);
void from_three(int nodes, const double* three, double* four);
void to_three(int nodes, const double* four, double* three);

} // namespace palpate
