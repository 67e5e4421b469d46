#include "solve.h"

namespace palpate {
namespace {

constexpr int pair_at(int m, int k, int terms) { return m * terms - m * (m - 1) / 2 + k - m; } // of pair m <= k

// Templates below: `fixed` terms and `wide` columns a voxel, or 0 for any number, so that the usual ones are unrolled.

// What voxel x sees of a view. Slope: Σ over columns and terms of (along x) · (slope + curvature · what has changed
// since); curvature: Σ over columns and pairs of terms.
template <int fixed, int wide> PALPATE_INLINE void look(const LineView& v, int x, Lanes& slope, Lanes& curvature) {
    const int terms = fixed ? fixed : v.terms, width = wide ? wide : v.width;
    const int size = terms + pairs_of(terms), cell = (size + terms) * lanes;
    const float *weight = v.weight + int64_t(x) * width * size, *cells = v.cells + int64_t(v.first[x] - v.begin) * cell;
    Lanes first = {}, second = {};
    for (int t = 0; t < width; t++, weight += size, cells += cell) {
        for (int m = 0; m < terms; m++) {
            Lanes h, c, p;
            load(h, cells + m * lanes);
            for (int k = 0; k < terms; k++) {
                load(c, cells + (terms + (m < k ? pair_at(m, k, terms) : pair_at(k, m, terms))) * lanes);
                load(p, cells + (size + k) * lanes);
                h += c * p;
            }
            first += weight[m] * h;
        }
        for (int q = terms; q < size; q++) {
            Lanes c;
            load(c, cells + q * lanes);
            second += weight[q] * c;
        }
    }
    slope += first;
    curvature += second;
}

template <int fixed, int wide> PALPATE_INLINE void change_by(const LineView& v, int x, const Lanes& change) {
    const int terms = fixed ? fixed : v.terms, width = wide ? wide : v.width;
    const int size = terms + pairs_of(terms), cell = (size + terms) * lanes;
    const float* weight = v.weight + int64_t(x) * width * size;
    float* p = v.cells + int64_t(v.first[x] - v.begin) * cell + size * lanes;
    for (int t = 0; t < width; t++, weight += size, p += cell)
        for (int m = 0; m < terms; m++) {
            Lanes sum;
            load(sum, p + m * lanes);
            sum += weight[m] * change;
            store(p + m * lanes, sum);
        }
}

PALPATE_INLINE void measure(const Line& line, int x, Lanes& slope, Lanes& curvature) {
    for (const LineView& v : line.views) switch (v.kind) {
        case 12:
            look<1, 2>(v, x, slope, curvature);
            break;
        case 13:
            look<1, 3>(v, x, slope, curvature);
            break;
        case 14:
            look<1, 4>(v, x, slope, curvature);
            break;
        case 22:
            look<2, 2>(v, x, slope, curvature);
            break;
        case 23:
            look<2, 3>(v, x, slope, curvature);
            break;
        case 24:
            look<2, 4>(v, x, slope, curvature);
            break;
        case 10:
            look<1, 0>(v, x, slope, curvature);
            break;
        case 20:
            look<2, 0>(v, x, slope, curvature);
            break;
        default:
            look<0, 0>(v, x, slope, curvature);
            break;
        }
}

PALPATE_INLINE void move(const Line& line, int x, const Lanes& change) {
    for (const LineView& v : line.views) switch (v.kind) {
        case 12:
            change_by<1, 2>(v, x, change);
            break;
        case 13:
            change_by<1, 3>(v, x, change);
            break;
        case 14:
            change_by<1, 4>(v, x, change);
            break;
        case 22:
            change_by<2, 2>(v, x, change);
            break;
        case 23:
            change_by<2, 3>(v, x, change);
            break;
        case 24:
            change_by<2, 4>(v, x, change);
            break;
        case 10:
            change_by<1, 0>(v, x, change);
            break;
        case 20:
            change_by<2, 0>(v, x, change);
            break;
        default:
            change_by<0, 0>(v, x, change);
            break;
        }
}

// ψ'(t)/t of eight pairs. Lange's is written in vectors: the loop over lanes would go through memory, one at a time.
template <Potential potential> PALPATE_INLINE void curvature_at(const Law& law, const Lanes& t, Lanes& out) {
    if constexpr (potential == Potential::lange) {
        Lanes size;
        choose(t < Lanes{}, -t, t, size);
        out = law.edge / (law.edge + size);
    } else {
        float in[lanes], k[lanes];
        store(in, t);
        for (int i = 0; i < lanes; i++) k[i] = potential_curvature<potential>(law, in[i]);
        load(out, k);
    }
}

// A pair of neighbours along x.
template <Potential potential>
PALPATE_INLINE void add_pair(const Lanes& old, const float* other, float weight, const Law& law, Lanes& slope,
                             Lanes& bend) {
    Lanes t, k;
    load(t, other);
    t = old - t;
    curvature_at<potential>(law, t, k);
    k *= weight;
    slope += k * t;
    bend += k;
}

// Numerical kernel.
template <Potential potential>
PALPATE_INLINE void solve_with(const Solve& s, Line& line, int count, bool backwards, const Strip& strip,
                               Paraboloid& data, Lists::Scratch& scratch) {
    const int nx = int(s.neighbours.nx);
    const float beside = s.neighbours.weight[1][1][0], beta = s.beta;
    const Law law = s.neighbours.law;
    const Lanes zero = {};
    for (int j = 0; j < count; j++) {
        const int i = backwards ? count - 1 - j : j, x = line.begin + i;
        Lanes slope = {}, curvature = {}, old, moved;
        measure(line, x, slope, curvature);
        if (!s.lists.empty()) s.lists.measure(strip, x, data, scratch, slope, curvature);
        float* f = line.f.data() + (i + 1) * lanes;
        load(old, f);
        if (beta > 0) {
            Lanes push, bend;
            load(push, line.gradient.data() + i * lanes);
            load(bend, line.curvature.data() + i * lanes);
            add_pair<potential>(old, f - lanes, x > 0 ? beside : 0, law, push, bend);
            add_pair<potential>(old, f + lanes, x + 1 < nx ? beside : 0, law, push, bend);
            slope += beta * push;
            curvature += beta * bend;
        }
        moved = old - s.relaxation * slope / curvature;
        choose(moved > zero, moved, zero, moved);
        choose(curvature > zero, moved, old, moved); // else seen by no ray, tied to no neighbour
        store(f, moved);
        moved -= old;
        move(line, x, moved);
        if (!s.lists.empty()) s.lists.move(strip, moved, data, scratch);
    }
}

PALPATE_KERNEL void solve(const Solve& s, Line& line, int count, bool backwards, const Strip& strip, Paraboloid& data,
                          Lists::Scratch& scratch) {
    switch (s.neighbours.law.potential) {
    case Potential::quadratic:
        return solve_with<Potential::quadratic>(s, line, count, backwards, strip, data, scratch);
    case Potential::huber:
        return solve_with<Potential::huber>(s, line, count, backwards, strip, data, scratch);
    case Potential::lange:
        return solve_with<Potential::lange>(s, line, count, backwards, strip, data, scratch);
    case Potential::hyperbola:
        return solve_with<Potential::hyperbola>(s, line, count, backwards, strip, data, scratch);
    case Potential::generalised:
        return solve_with<Potential::generalised>(s, line, count, backwards, strip, data, scratch);
    case Potential::tabulated:
        return solve_with<Potential::tabulated>(s, line, count, backwards, strip, data, scratch);
    }
}

} // namespace

void Solve::along(Line& line, int count, bool backwards, const Strip& strip, Paraboloid& data,
                  Lists::Scratch& scratch) const {
    solve(*this, line, count, backwards, strip, data, scratch);
}

PALPATE_KERNEL void line_curvature(const Line& line, int count, float* out) {
    for (int i = 0; i < count; i++) {
        Lanes slope = {}, sum = {};
        measure(line, line.begin + i, slope, sum);
        store(out + i * lanes, sum);
    }
}

} // namespace palpate
