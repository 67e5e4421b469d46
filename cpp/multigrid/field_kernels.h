#pragma once
// Fused loops over displacement fields and their images under K. MultigridModel calls them in the loop's thread.
#include "base/aligned_buffer.h"
#include <vector>

namespace palpate {

// Four numbers per node: float64 (wide) for the solution, float32 (narrow) for what is kept of earlier ticks.
using Field = std::vector<double, CacheAlignedAllocator<double>>;

// A field of either width: the pointer that is not null.
struct FieldView {
    const double* wide = nullptr;
    const float* narrow = nullptr;
    FieldView(const Field& f) : wide(f.data()) {}
    FieldView(const float* f) : narrow(f) {}
    FieldView(const AlignedBuffer& f) : narrow(f.data()) {}
};

// In all of them `count` >= 1 is the number of narrow fields, and sums have a fixed order.

// out: v . wide, unless that is null, then v . narrow[k].
void dots(int nodes, const FieldView& v, const double* wide, int count, const float* const* narrow, double* out);

// out = factor wide + sum of c[k] narrow[k].
void combine(int nodes, double factor, const double* wide, int count, const float* const* narrow, const double* c,
             double* out);

// p = z - sum c_k Z_k + beta p, and the same for its image. products: p . image, p . force.
void update_direction(int nodes, const float* z, const float* image_z, int count, const float* const* Z,
                      const float* const* KZ, const double* c, double beta, double* p, double* image,
                      const double* force, double products[2]);

// (z - sum c_k Z_k) . v
double projected_dot(int nodes, const float* z, int count, const float* const* Z, const double* c, const double* v);

// For a tick of one iteration: each field is read once.

// out = factor wide + sum of c[k] narrow[k], rounded to float32.
void combine(int nodes, double factor, const double* wide, int count, const float* const* narrow, const double* c,
             float* out);

// increment = factor u + sum of c[k] narrow[k]; u += increment; change = increment, rounded; out (nodes, 3) by `order`
// becomes u. change may be one of the fields. scratch: a field, used if there are more than six narrow ones.
void add_combination(int nodes, double factor, int count, const float* const* narrow, const double* c, const int* order,
                     double* u, float* change, double* out, double* scratch);

// force += image; then of_image: image . u, image . narrow[k]; of_force: force . u, force . narrow[k].
void add_and_dots(int nodes, const float* image, double* force, const double* u, int count, const float* const* narrow,
                  double* of_image, double* of_force);

// u += alpha p.
void add_scaled(int nodes, double alpha, const double* p, double* u);
void add_scaled(int nodes, double alpha, const float* p, double* u);

// out = factor from, rounded to float32.
void round_scaled(int nodes, double factor, const double* from, float* out);

} // namespace palpate
