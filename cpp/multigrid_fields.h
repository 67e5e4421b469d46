#pragma once
#include "buffer.h"
#include <vector>

namespace palpate {

// Displacement fields and their images under K, four numbers a node, in float64 or float32.
using Field = std::vector<double, CacheAligned<double>>;

// A field in the one or the other: the one that is not null.
struct Column {
    const double* wide = nullptr;
    const float* narrow = nullptr;
};

// out: v . wide, then v . narrow[k], in a fixed order of sums. count >= 1.
void dots(int nodes, const Column& v, const double* wide, int count, const float* const* narrow, double* out);

// out = factor wide + sum of c[k] narrow[k]. count >= 1.
void combine(int nodes, double factor, const double* wide, int count, const float* const* narrow, const double* c,
             double* out);

// p = z - sum c_k Z_k + beta p, and its image likewise. products: p . image, p . force.
void direction(int nodes, const float* z, const float* image_z, int count, const float* const* Z,
               const float* const* KZ, const double* c, double beta, double* p, double* image, const double* force,
               double products[2]);

// (z - sum c_k Z_k) . v
double projected_dot(int nodes, const float* z, int count, const float* const* Z, const double* c, const double* v);

// What a tick of one iteration needs, each field read once. count >= 1.

// out = factor wide + sum of c[k] narrow[k], rounded.
void combine(int nodes, double factor, const double* wide, int count, const float* const* narrow, const double* c,
             float* out);

// out[k] = v . with[k].
void dots(int nodes, const float* v, int count, const float* const* with, double* out);

// gain = factor u + sum of c[k] narrow[k]; u += gain; change = gain, rounded; out, (nodes, 3) by `order`, takes u.
// change may be one of the fields. spare: room for a field, used where they are more than six.
void take(int nodes, double factor, int count, const float* const* narrow, const double* c, const int* order, double* u,
          float* change, double* out, double* spare);

// force += image; then of_image: image . u, image . narrow[k]; of_force: force . u, force . narrow[k].
void add_and_dots(int nodes, const float* image, double* force, const double* u, int count, const float* const* narrow,
                  double* of_image, double* of_force);

// u += alpha p.
void step(int nodes, double alpha, const double* p, double* u);
void step(int nodes, double alpha, const float* p, double* u);

void to_narrow(int nodes, double factor, const double* from, float* out);

} // namespace palpate
