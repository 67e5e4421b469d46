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

// sum += the fields at a node times their coefficients, one after the other.
template <int size> PALPATE_INLINE void add_fields(const FieldGroup<size>& fields, size_t at, f64x4& sum) {
    f64x4 v;
    PALPATE_UNROLL
    for (int j = 0; j < size; j++) read(fields.field[j], at, v), sum += fields.coefficient[j] * v;
}

// sums: v . wide unless that is null, then v . each field; v in float64 or, if that is null, in float32.
PALPATE_KERNEL void five_dots(int nodes, const double* v, const float* v_narrow, const double* wide,
                              const FieldGroup<group>& given, double* sums) {
    const FieldGroup<group> fields = given;
    f64x4 w = {}, s[group] = {}, a, b;
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        if (v)
            load(a, v + i);
        else
            read(v_narrow, i, a);
        if (wide) load(b, wide + i), w += a * b;
        PALPATE_UNROLL
        for (int j = 0; j < group; j++) read(fields.field[j], i, b), s[j] += a * b;
    }
    if (wide) *sums++ = total(w);
    for (int j = 0; j < group; j++) sums[j] = total(s[j]);
}

PALPATE_KERNEL void five_combined(int nodes, double factor, const double* wide, const FieldGroup<group>& given,
                                  double* out) {
    const FieldGroup<group> fields = given;
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        f64x4 sum;
        load(sum, wide + i), sum *= factor;
        add_fields(fields, i, sum);
        store(out + i, sum);
    }
}

PALPATE_KERNEL void five_combined_rounded(int nodes, double factor, const double* wide, const float* more,
                                          const FieldGroup<group>& given, float* out) {
    const FieldGroup<group> fields = given;
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        f64x4 sum;
        f32x4 f;
        if (more)
            read(more, i, sum);
        else
            load(sum, wide + i), sum *= factor;
        add_fields(fields, i, sum);
        narrow(sum, f), store(out + i, f);
    }
}

PALPATE_KERNEL void six_added_to_u(int nodes, double factor, const double* more, const FieldGroup<group + 1>& given,
                                   const int* order, double* u, float* change, double* out) {
    const FieldGroup<group + 1> fields = given;
    for (int node = 0; node < nodes; node++) {
        const size_t i = 4 * size_t(node);
        f64x4 sum, v, now;
        f32x4 f;
        load(now, u + i), sum = factor * now;
        if (more) load(v, more + i), sum += v;
        add_fields(fields, i, sum);
        now += sum;
        store(u + i, now);
        narrow(sum, f), store(change + i, f);
        double* to = out + 3 * size_t(order[node]);
        to[0] = now[0], to[1] = now[1], to[2] = now[2];
    }
}

// image_sums, force_sums: image . u and force . u, then of each field.
PALPATE_KERNEL void image_added(int nodes, const float* image, bool add, double* force, const double* u,
                                const FieldGroup<group>& given, double* image_sums, double* force_sums) {
    const FieldGroup<group> fields = given;
    f64x4 p[1 + group] = {}, q[1 + group] = {};
    for (size_t i = 0; i < 4 * size_t(nodes); i += 4) {
        f64x4 a, f, b;
        read(image, i, a), load(f, force + i);
        if (add) f += a, store(force + i, f);
        load(b, u + i), p[0] += a * b, q[0] += f * b;
        PALPATE_UNROLL
        for (int j = 0; j < group; j++) read(fields.field[j], i, b), p[1 + j] += a * b, q[1 + j] += f * b;
    }
    for (int j = 0; j <= group; j++) image_sums[j] = total(p[j]), force_sums[j] = total(q[j]);
}

} // namespace

void dots(int nodes, const FieldView& v, const double* wide, int count, const float* const* narrow, double* out) {
    const int first = wide ? 1 : 0; // place of the narrow ones
    for (int k = 0; k == 0 || k < count; k += group) {
        double sums[1 + group];
        five_dots(nodes, v.wide, v.narrow, wide, FieldGroup<group>(k, count, narrow), sums);
        if (wide) out[0] = sums[0];
        std::copy_n(sums + first, std::min(group, count - k), out + first + k);
    }
}

void combine(int nodes, double factor, const double* wide, int count, const float* const* narrow, const double* c,
             double* out) {
    for (int k = 0; k == 0 || k < count; k += group)
        five_combined(nodes, k == 0 ? factor : 1, k == 0 ? wide : out, FieldGroup<group>(k, count, narrow, c), out);
}

void combine(int nodes, double factor, const double* wide, int count, const float* const* narrow, const double* c,
             float* out) {
    for (int k = 0; k == 0 || k < count; k += group)
        five_combined_rounded(nodes, factor, wide, k == 0 ? nullptr : out, FieldGroup<group>(k, count, narrow, c), out);
}

void add_combination(int nodes, double factor, int count, const float* const* narrow, const double* c, const int* order,
                     double* u, float* change, double* out, double* scratch) {
    constexpr int most = group + 1;
    const int remaining = std::max(0, count - most);
    if (remaining > 0) combine(nodes, 0, u, remaining, narrow, c, scratch);
    six_added_to_u(nodes, factor, remaining > 0 ? scratch : nullptr, FieldGroup<most>(remaining, count, narrow, c),
                   order, u, change, out);
}

void add_and_dots(int nodes, const float* image, double* force, const double* u, int count, const float* const* narrow,
                  double* of_image, double* of_force) {
    for (int k = 0; k < count; k += group) {
        double image_sums[1 + group], force_sums[1 + group];
        image_added(nodes, image, k == 0, force, u, FieldGroup<group>(k, count, narrow), image_sums, force_sums);
        const int some = std::min(group, count - k);
        of_image[0] = image_sums[0], of_force[0] = force_sums[0];
        std::copy_n(image_sums + 1, some, of_image + 1 + k);
        std::copy_n(force_sums + 1, some, of_force + 1 + k);
    }
}

PALPATE_KERNEL void update_direction(int nodes, const float* z, const float* image_z, int count, const float* const* Z,
                                     const float* const* KZ, const double* c, double beta, double* p, double* image,
                                     const double* force, double products[2]) {
    f64x4 pp = {}, pf = {};
    for (int i = 0; i < nodes; i++) {
        const size_t at = 4 * size_t(i);
        f64x4 a, b, old, v;
        read(z, at, a), read(image_z, at, b);
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
        f64x4 a, v;
        read(z, 4 * size_t(i), a);
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
        f64x4 a, b;
        read(p, i, a), load(b, u + i);
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
