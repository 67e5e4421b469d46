#include "multigrid_fields.h"
#include "four.h"
#include <algorithm>

namespace palpate {
namespace {

PALPATE_INLINE void fetch(const Column& column, int i, Quad& v) {
    if (column.wide) {
        load(v, column.wide + 4 * size_t(i));
    } else {
        Four f;
        load(f, column.narrow + 4 * size_t(i));
        widen(f, v);
    }
}

// Four vectors at a time: each is read once for all that it meets.
PALPATE_KERNEL void some_dots(int nodes, const Column* v, int count, const Column* with, double* out) {
    Quad sum[4] = {};
    for (int i = 0; i < nodes; i++) {
        Quad a, b;
        fetch(*v, i, a);
        for (int k = 0; k < count; k++) fetch(with[k], i, b), sum[k] += a * b;
    }
    for (int k = 0; k < count; k++) out[k] = total(sum[k]);
}

PALPATE_KERNEL void combine_all(int nodes, int count, const Column* column, const double* coefficient, double* out) {
    for (int i = 0; i < nodes; i++) {
        Quad sum = {}, v;
        for (int c = 0; c < count; c++) fetch(column[c], i, v), sum += coefficient[c] * v;
        store(out + 4 * size_t(i), sum);
    }
}

PALPATE_KERNEL void direct(int nodes, const float* z, const float* image_z, int count, const Column* Z,
                           const Column* KZ, const double* c, double beta, double* p, double* image,
                           const double* force, double products[2]) {
    Quad pp = {}, pf = {};
    for (int i = 0; i < nodes; i++) {
        const size_t at = 4 * size_t(i);
        Four f;
        Quad a, b, old, v;
        load(f, z + at), widen(f, a);
        load(f, image_z + at), widen(f, b);
        for (int k = 0; k < count; k++) {
            fetch(Z[k], i, v), a -= c[k] * v;
            fetch(KZ[k], i, v), b -= c[k] * v;
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

PALPATE_KERNEL double projected(int nodes, const float* z, int count, const Column* Z, const double* c,
                                const double* with) {
    Quad sum = {};
    for (int i = 0; i < nodes; i++) {
        Four f;
        Quad a, v;
        load(f, z + 4 * size_t(i)), widen(f, a);
        for (int k = 0; k < count; k++) fetch(Z[k], i, v), a -= c[k] * v;
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

void dots(int nodes, const Column& v, int count, const Column* with, double* out) {
    for (int k = 0; k < count; k += 4) some_dots(nodes, &v, std::min(4, count - k), with + k, out + k);
}

void combine(int nodes, int count, const Column* column, const double* coefficient, double* out) {
    combine_all(nodes, count, column, coefficient, out);
}

void direction(int nodes, const float* z, const float* image_z, int count, const Column* Z, const Column* KZ,
               const double* c, double beta, double* p, double* image, const double* force, double products[2]) {
    direct(nodes, z, image_z, count, Z, KZ, c, beta, p, image, force, products);
}

double projected_dot(int nodes, const float* z, int count, const Column* Z, const double* c, const double* v) {
    return projected(nodes, z, count, Z, c, v);
}

void step(int nodes, double alpha, const double* p, double* u) { add(nodes, alpha, p, u); }
void step(int nodes, double alpha, const float* p, double* u) { add_narrow(nodes, alpha, p, u); }

void to_narrow(int nodes, double factor, const double* from, float* out) { round(nodes, factor, from, out); }

} // namespace palpate
