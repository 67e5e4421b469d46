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

PALPATE_KERNEL void unpack(const double* wide, const float* narrow, int first, int nodes, double* out) {
    Column column{wide, narrow};
    Quad v;
    for (int i = 0; i < nodes; i++) fetch(column, first + i, v), store(out + 4 * size_t(i), v);
}

PALPATE_KERNEL double short_dot(const double* a, const double* b, int n) {
    Quad s = {}, t = {}, x, y;
    int i = 0;
    for (; i + 8 <= n; i += 8) {
        load(x, a + i), load(y, b + i), s += x * y;
        load(x, a + i + 4), load(y, b + i + 4), t += x * y;
    }
    for (; i < n; i += 4) load(x, a + i), load(y, b + i), s += x * y;
    s += t;
    return total(s);
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
                           const double* force, double dots[2]) {
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
    dots[0] = total(pp), dots[1] = total(pf);
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

PALPATE_KERNEL double mixed_dot(int nodes, const float* a, const double* b) {
    Quad sum = {};
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        Four f;
        Quad x, y;
        load(f, a + i), widen(f, x), load(y, b + i);
        sum += x * y;
    }
    return total(sum);
}

PALPATE_KERNEL void round(int nodes, double factor, const double* from, float* out) {
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        Quad a;
        Four f;
        load(a, from + i), a *= factor, narrow(a, f), store(out + i, f);
    }
}

} // namespace

void gram(int nodes, int count, const Column* field, const Column* image, double* scratch, double* out) {
    std::fill_n(out, size_t(count) * count, 0.0);
    double *V = scratch, *KV = scratch + size_t(count) * fields_block;
    constexpr int block = fields_block / 4;
    for (int first = 0; first < nodes; first += block) {
        const int some = std::min(block, nodes - first);
        for (int c = 0; c < count; c++) {
            unpack(field[c].wide, field[c].narrow, first, some, V + size_t(c) * fields_block);
            unpack(image[c].wide, image[c].narrow, first, some, KV + size_t(c) * fields_block);
        }
        for (int a = 0; a < count; a++)
            for (int b = 0; b <= a; b++)
                out[a * count + b] += short_dot(V + size_t(a) * fields_block, KV + size_t(b) * fields_block, 4 * some);
    }
}

void combine(int nodes, int count, const Column* column, const double* coefficient, double* out) {
    combine_all(nodes, count, column, coefficient, out);
}

void direction(int nodes, const float* z, const float* image_z, int count, const Column* Z, const Column* KZ,
               const double* c, double beta, double* p, double* image, const double* force, double dots[2]) {
    direct(nodes, z, image_z, count, Z, KZ, c, beta, p, image, force, dots);
}

double projected_dot(int nodes, const float* z, int count, const Column* Z, const double* c, const double* v) {
    return projected(nodes, z, count, Z, c, v);
}

void step(int nodes, double alpha, const double* p, double* u) { add(nodes, alpha, p, u); }

double dot(int nodes, const double* a, const double* b) { return short_dot(a, b, 4 * nodes); }
double dot(int nodes, const float* a, const double* b) { return mixed_dot(nodes, a, b); }

void to_narrow(int nodes, double factor, const double* from, float* out) { round(nodes, factor, from, out); }

void from_three(int nodes, const double* three, double* four) {
    for (size_t i = 0; i < size_t(nodes); i++) {
        for (int k = 0; k < 3; k++) four[4 * i + k] = three[3 * i + k];
        four[4 * i + 3] = 0;
    }
}

void to_three(int nodes, const double* four, double* three) {
    for (size_t i = 0; i < size_t(nodes); i++)
        for (int k = 0; k < 3; k++) three[3 * i + k] = four[4 * i + k];
}

} // namespace palpate
