#pragma once
#include "buffer.h"
#include <vector>

namespace palpate {

// Displacement fields and their images under K, four numbers a node, in float64 or float32.
using Field = std::vector<double, CacheAligned<double>>;

// One vector of a span: the one that is not null.
struct Column {
    const double* wide = nullptr;
    const float* narrow = nullptr;
};

// out[k] = v . with[k], in a fixed order of sums.
void dots(int nodes, const Column& v, int count, const Column* with, double* out);

// out = sum of coefficient[c] column[c].
void combine(int nodes, int count, const Column* column, const double* coefficient, double* out);

// p = z - sum c_k Z_k + beta p, and its image likewise. dots: p . image, p . force.
void direction(int nodes, const float* z, const float* image_z, int count, const Column* Z, const Column* KZ,
               const double* c, double beta, double* p, double* image, const double* force, double products[2]);

// (z - sum c_k Z_k) . v
double projected_dot(int nodes, const float* z, int count, const Column* Z, const double* c, const double* v);

// u += alpha p.
void step(int nodes, double alpha, const double* p, double* u);
void step(int nodes, double alpha, const float* p, double* u);

void to_narrow(int nodes, double factor, const double* from, float* out);

} // namespace palpate
