#include "multigrid_fields.h"
#include "four.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr int group = 5; // narrow vectors at a time: a tick's two changes and three lifts

PALPATE_INLINE void read(const float* p, size_t at, Quad& v) {
    Four f;
    load(f, p + at), widen(f, v);
}

// sums: v . wide, v . narrow[0..4]; v in float64 or, if that is null, in float32.
PALPATE_KERNEL void five_dots(int nodes, const double* v, const float* v_narrow, const double* wide,
                              const float* const* narrow, double* sums) {
    const float *n0 = narrow[0], *n1 = narrow[1], *n2 = narrow[2], *n3 = narrow[3], *n4 = narrow[4];
    Quad w = {}, s0 = {}, s1 = {}, s2 = {}, s3 = {}, s4 = {}, a, b;
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        if (v)
            load(a, v + i);
        else
            read(v_narrow, i, a);
        load(b, wide + i), w += a * b;
        read(n0, i, b), s0 += a * b;
        read(n1, i, b), s1 += a * b;
        read(n2, i, b), s2 += a * b;
        read(n3, i, b), s3 += a * b;
        read(n4, i, b), s4 += a * b;
    }
    sums[0] = total(w), sums[1] = total(s0), sums[2] = total(s1), sums[3] = total(s2), sums[4] = total(s3);
    sums[5] = total(s4);
}

PALPATE_KERNEL void five_combined(int nodes, double factor, const double* wide, const float* const* narrow,
                                  const double* c, double* out) {
    const float *n0 = narrow[0], *n1 = narrow[1], *n2 = narrow[2], *n3 = narrow[3], *n4 = narrow[4];
    const double c0 = c[0], c1 = c[1], c2 = c[2], c3 = c[3], c4 = c[4];
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        Quad sum, v;
        load(sum, wide + i), sum *= factor;
        read(n0, i, v), sum += c0 * v;
        read(n1, i, v), sum += c1 * v;
        read(n2, i, v), sum += c2 * v;
        read(n3, i, v), sum += c3 * v;
        read(n4, i, v), sum += c4 * v;
        store(out + i, sum);
    }
}

PALPATE_KERNEL void direct(int nodes, const float* z, const float* image_z, int count, const float* const* Z,
                           const float* const* KZ, const double* c, double beta, double* p, double* image,
                           const double* force, double products[2]) {
    Quad pp = {}, pf = {};
    for (int i = 0; i < nodes; i++) {
        const size_t at = 4 * size_t(i);
        Four f;
        Quad a, b, old, v;
        load(f, z + at), widen(f, a);
        load(f, image_z + at), widen(f, b);
        for (int k = 0; k < count; k++) {
            read(Z[k], at, v), a -= c[k] * v;
            read(KZ[k], at, v), b -= c[k] * v;
        }
        if (beta != 0) {
            load(old, p + at), a += beta * old;
            load(old, image + at), b += beta * old;
        }
        store(p + at, a), store(image + at, b);
        load(v, force + at);
        pp += a * b, pf += a * v;
    }
    products[0] = total(pp), products[1] = total(pf);
}

PALPATE_KERNEL double projected(int nodes, const float* z, int count, const float* const* Z, const double* c,
                                const double* with) {
    Quad sum = {};
    for (int i = 0; i < nodes; i++) {
        Four f;
        Quad a, v;
        load(f, z + 4 * size_t(i)), widen(f, a);
        for (int k = 0; k < count; k++) read(Z[k], 4 * size_t(i), v), a -= c[k] * v;
        load(v, with + 4 * size_t(i));
        sum += a * v;
    }
    return total(sum);
}

PALPATE_KERNEL void add(int nodes, double alpha, const double* p, double* u) {
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        Quad a, b;
        load(a, p + i), load(b, u + i);
        store(u + i, b + alpha * a);
    }
}

PALPATE_KERNEL void add_narrow(int nodes, double alpha, const float* p, double* u) {
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        Four f;
        Quad a, b;
        load(f, p + i), widen(f, a), load(b, u + i);
        store(u + i, b + alpha * a);
    }
}

PALPATE_KERNEL void round(int nodes, double factor, const double* from, float* out) {
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        Quad a;
        Four f;
        load(a, from + i), a *= factor, narrow(a, f), store(out + i, f);
    }
}

} // namespace

void dots(int nodes, const Column& v, const double* wide, int count, const float* const* narrow, double* out) {
    for (int k = 0; k == 0 || k < count; k += group) {
        const float* some[group];
        double sums[1 + group];
        for (int j = 0; j < group; j++) some[j] = narrow[std::min(k + j, count - 1)];
        five_dots(nodes, v.wide, v.narrow, wide, some, sums);
        out[0] = sums[0];
        for (int j = 0; j < group && k + j < count; j++) out[1 + k + j] = sums[1 + j];
    }
}

void combine(int nodes, double factor, const double* wide, int count, const float* const* narrow, const double* c,
             double* out) {
    for (int k = 0; k == 0 || k < count; k += group) {
        const float* some[group];
        double coefficient[group];
        for (int j = 0; j < group; j++) {
            some[j] = narrow[std::min(k + j, count - 1)];
            coefficient[j] = k + j < count ? c[k + j] : 0;
        }
        five_combined(nodes, k == 0 ? factor : 1, k == 0 ? wide : out, some, coefficient, out);
    }
}

void direction(int nodes, const float* z, const float* image_z, int count, const float* const* Z,
               const float* const* KZ, const double* c, double beta, double* p, double* image, const double* force,
               double products[2]) {
    direct(nodes, z, image_z, count, Z, KZ, c, beta, p, image, force, products);
}

double projected_dot(int nodes, const float* z, int count, const float* const* Z, const double* c, const double* v) {
    return projected(nodes, z, count, Z, c, v);
}

void step(int nodes, double alpha, const double* p, double* u) { add(nodes, alpha, p, u); }
void step(int nodes, double alpha, const float* p, double* u) { add_narrow(nodes, alpha, p, u); }

void to_narrow(int nodes, double factor, const double* from, float* out) { round(nodes, factor, from, out); }

} // namespace palpate
