#include "multigrid/field_kernels.h"
#include "base/simd.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr int group = 5; // narrow fields per pass: two changes and three lifts in a tick with one contact

PALPATE_INLINE void read(const float* p, size_t at, f64x4& v) {
    f32x4 f;
    load(f, p + at), widen(f, v);
}

// sums: v . wide, v . narrow[0..4]; v in float64 or, if that is null, in float32.
PALPATE_KERNEL void five_dots(int nodes, const double* v, const float* v_narrow, const double* wide,
                              const float* const* narrow, double* sums) {
    const float *n0 = narrow[0], *n1 = narrow[1], *n2 = narrow[2], *n3 = narrow[3], *n4 = narrow[4];
    f64x4 w = {}, s0 = {}, s1 = {}, s2 = {}, s3 = {}, s4 = {}, a, b;
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
        f64x4 sum, v;
        load(sum, wide + i), sum *= factor;
        read(n0, i, v), sum += c0 * v;
        read(n1, i, v), sum += c1 * v;
        read(n2, i, v), sum += c2 * v;
        read(n3, i, v), sum += c3 * v;
        read(n4, i, v), sum += c4 * v;
        store(out + i, sum);
    }
}

PALPATE_KERNEL void five_combined_rounded(int nodes, double factor, const double* wide, const float* more,
                                          const float* const* narrow, const double* c, float* out) {
    const float *n0 = narrow[0], *n1 = narrow[1], *n2 = narrow[2], *n3 = narrow[3], *n4 = narrow[4];
    const double c0 = c[0], c1 = c[1], c2 = c[2], c3 = c[3], c4 = c[4];
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        f64x4 sum, v;
        f32x4 f;
        if (more)
            read(more, i, sum);
        else
            load(sum, wide + i), sum *= factor;
        read(n0, i, v), sum += c0 * v;
        read(n1, i, v), sum += c1 * v;
        read(n2, i, v), sum += c2 * v;
        read(n3, i, v), sum += c3 * v;
        read(n4, i, v), sum += c4 * v;
        palpate::narrow(sum, f), store(out + i, f);
    }
}

PALPATE_KERNEL void five_narrow_dots(int nodes, const float* v, const float* const* with, double* sums) {
    const float *n0 = with[0], *n1 = with[1], *n2 = with[2], *n3 = with[3], *n4 = with[4];
    f64x4 s0 = {}, s1 = {}, s2 = {}, s3 = {}, s4 = {}, a, b;
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        read(v, i, a);
        read(n0, i, b), s0 += a * b;
        read(n1, i, b), s1 += a * b;
        read(n2, i, b), s2 += a * b;
        read(n3, i, b), s3 += a * b;
        read(n4, i, b), s4 += a * b;
    }
    sums[0] = total(s0), sums[1] = total(s1), sums[2] = total(s2), sums[3] = total(s3), sums[4] = total(s4);
}

PALPATE_KERNEL void six_added_to_u(int nodes, double factor, const double* more, const float* const* narrow,
                                   const double* c, const int* order, double* u, float* change, double* out) {
    const float *n0 = narrow[0], *n1 = narrow[1], *n2 = narrow[2], *n3 = narrow[3], *n4 = narrow[4], *n5 = narrow[5];
    const double c0 = c[0], c1 = c[1], c2 = c[2], c3 = c[3], c4 = c[4], c5 = c[5];
    for (int node = 0; node < nodes; node++) {
        const size_t i = 4 * size_t(node);
        f64x4 sum, v, now;
        f32x4 f;
        load(now, u + i), sum = factor * now;
        if (more) load(v, more + i), sum += v;
        read(n0, i, v), sum += c0 * v;
        read(n1, i, v), sum += c1 * v;
        read(n2, i, v), sum += c2 * v;
        read(n3, i, v), sum += c3 * v;
        read(n4, i, v), sum += c4 * v;
        read(n5, i, v), sum += c5 * v;
        now += sum;
        store(u + i, now);
        palpate::narrow(sum, f), store(change + i, f);
        double* to = out + 3 * size_t(order[node]);
        to[0] = now[0], to[1] = now[1], to[2] = now[2];
    }
}

// sums: image . u and force . u, then of each narrow field.
PALPATE_KERNEL void image_added(int nodes, const float* image, bool add, double* force, const double* u,
                                const float* const* narrow, double* sums) {
    const float *n0 = narrow[0], *n1 = narrow[1], *n2 = narrow[2], *n3 = narrow[3], *n4 = narrow[4];
    f64x4 p = {}, q = {}, p0 = {}, q0 = {}, p1 = {}, q1 = {}, p2 = {}, q2 = {}, p3 = {}, q3 = {}, p4 = {}, q4 = {};
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        f64x4 a, f, b;
        read(image, i, a), load(f, force + i);
        if (add) f += a, store(force + i, f);
        load(b, u + i), p += a * b, q += f * b;
        read(n0, i, b), p0 += a * b, q0 += f * b;
        read(n1, i, b), p1 += a * b, q1 += f * b;
        read(n2, i, b), p2 += a * b, q2 += f * b;
        read(n3, i, b), p3 += a * b, q3 += f * b;
        read(n4, i, b), p4 += a * b, q4 += f * b;
    }
    sums[0] = total(p), sums[1] = total(q), sums[2] = total(p0), sums[3] = total(q0), sums[4] = total(p1);
    sums[5] = total(q1), sums[6] = total(p2), sums[7] = total(q2), sums[8] = total(p3), sums[9] = total(q3);
    sums[10] = total(p4), sums[11] = total(q4);
}

// Fields k .. k + size, with their coefficients where there are any; remaining the last one, with coefficient 0.
template <int size> struct FieldGroup {
    const float* field[size];
    double coefficient[size] = {};
    FieldGroup(int k, int count, const float* const* narrow, const double* c = nullptr) {
        for (int j = 0; j < size; j++) {
            field[j] = narrow[std::min(k + j, count - 1)];
            if (c && k + j < count) coefficient[j] = c[k + j];
        }
    }
};

} // namespace

void dots(int nodes, const FieldView& v, const double* wide, int count, const float* const* narrow, double* out) {
    for (int k = 0; k == 0 || k < count; k += group) {
        double sums[1 + group];
        five_dots(nodes, v.wide, v.narrow, wide, FieldGroup<group>(k, count, narrow).field, sums);
        out[0] = sums[0];
        for (int j = 0; j < group && k + j < count; j++) out[1 + k + j] = sums[1 + j];
    }
}

void combine(int nodes, double factor, const double* wide, int count, const float* const* narrow, const double* c,
             double* out) {
    for (int k = 0; k == 0 || k < count; k += group) {
        const FieldGroup<group> next(k, count, narrow, c);
        five_combined(nodes, k == 0 ? factor : 1, k == 0 ? wide : out, next.field, next.coefficient, out);
    }
}

void combine(int nodes, double factor, const double* wide, int count, const float* const* narrow, const double* c,
             float* out) {
    for (int k = 0; k == 0 || k < count; k += group) {
        const FieldGroup<group> next(k, count, narrow, c);
        five_combined_rounded(nodes, factor, wide, k == 0 ? nullptr : out, next.field, next.coefficient, out);
    }
}

void dots(int nodes, const float* v, int count, const float* const* with, double* out) {
    for (int k = 0; k < count; k += group) {
        double sums[group];
        five_narrow_dots(nodes, v, FieldGroup<group>(k, count, with).field, sums);
        for (int j = 0; j < group && k + j < count; j++) out[k + j] = sums[j];
    }
}

void add_combination(int nodes, double factor, int count, const float* const* narrow, const double* c, const int* order,
                     double* u, float* change, double* out, double* scratch) {
    constexpr int most = group + 1;
    const int remaining = std::max(0, count - most);
    if (remaining > 0) combine(nodes, 0, u, remaining, narrow, c, scratch);
    const FieldGroup<most> last(remaining, count, narrow, c);
    six_added_to_u(nodes, factor, remaining > 0 ? scratch : nullptr, last.field, last.coefficient, order, u, change,
                   out);
}

void add_and_dots(int nodes, const float* image, double* force, const double* u, int count, const float* const* narrow,
                  double* of_image, double* of_force) {
    for (int k = 0; k < count; k += group) {
        double sums[2 + 2 * group];
        image_added(nodes, image, k == 0, force, u, FieldGroup<group>(k, count, narrow).field, sums);
        of_image[0] = sums[0], of_force[0] = sums[1];
        for (int j = 0; j < group && k + j < count; j++)
            of_image[1 + k + j] = sums[2 + 2 * j], of_force[1 + k + j] = sums[3 + 2 * j];
    }
}

PALPATE_KERNEL void update_direction(int nodes, const float* z, const float* image_z, int count, const float* const* Z,
                                     const float* const* KZ, const double* c, double beta, double* p, double* image,
                                     const double* force, double products[2]) {
    f64x4 pp = {}, pf = {};
    for (int i = 0; i < nodes; i++) {
        const size_t at = 4 * size_t(i);
        f32x4 f;
        f64x4 a, b, old, v;
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

PALPATE_KERNEL double projected_dot(int nodes, const float* z, int count, const float* const* Z, const double* c,
                                    const double* with) {
    f64x4 sum = {};
    for (int i = 0; i < nodes; i++) {
        f32x4 f;
        f64x4 a, v;
        load(f, z + 4 * size_t(i)), widen(f, a);
        for (int k = 0; k < count; k++) read(Z[k], 4 * size_t(i), v), a -= c[k] * v;
        load(v, with + 4 * size_t(i));
        sum += a * v;
    }
    return total(sum);
}

PALPATE_KERNEL void add_scaled(int nodes, double alpha, const double* p, double* u) {
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        f64x4 a, b;
        load(a, p + i), load(b, u + i);
        store(u + i, b + alpha * a);
    }
}

PALPATE_KERNEL void add_scaled(int nodes, double alpha, const float* p, double* u) {
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        f32x4 f;
        f64x4 a, b;
        load(f, p + i), widen(f, a), load(b, u + i);
        store(u + i, b + alpha * a);
    }
}

PALPATE_KERNEL void round_scaled(int nodes, double factor, const double* from, float* out) {
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        f64x4 a;
        f32x4 f;
        load(a, from + i), a *= factor, narrow(a, f), store(out + i, f);
    }
}

} // namespace palpate
