#pragma once
#include "dispatch.h"
#include "geometry.h"
#include <algorithm>
#include <cmath>

namespace palpate {

// A voxel's edge that moves from p1 to p2 evenly over the thickness t in [0, 1] of a sub-slice, in pixels. Real is
// float or double.
template <class Real> struct Crossing {
    Real move, speed, low, per;

    PALPATE_INLINE Crossing(Real p1, Real p2)
        : move(p2 - p1), speed(std::max(std::fabs(move), Real(1e-6))), low(std::min(p1, p2)), per(1 / speed) {}
    // When it gets to the beginning of pixel q, if it moves upwards.
    PALPATE_INLINE Real reaches(Real q) const { return std::min(std::max((q - low) * per, Real(0)), Real(1)); }
    // The part of pixel q, [q, q + 1], left of the edge, which is on it from t0 to t1: its moments with the Legendre
    // polynomials 1, √3 (2t - 1), √5 (6t² - 6t + 1), by parts.
    //
    // Where the edge leaves less than `trim` of the pixel on one side of it, and so of a voxel, its other side gets it
    // all: the last pixels of a long trapezoid weigh next to nothing and cost as much as any other. Between once and
    // twice `trim` the moments come on evenly, so that rounding decides nothing. per_trim: 1 / trim, or `untrimmed`.
    PALPATE_INLINE void cover(Real q, Real t0, Real t1, int moments, Real per_trim, Real* out) const {
        out[0] = (1 - t1) + (t1 - t0) * (low - q + Real(0.5) * speed * (t0 + t1));
        if (moments > 1)
            out[1] =
                Real(1.7320508075688772) * move * (t1 * t1 * (Real(0.5) - t1 / 3) - t0 * t0 * (Real(0.5) - t0 / 3));
        if (moments > 2) {
            const Real s0 = t0 * (1 - t0), s1 = t1 * (1 - t1);
            out[2] =
                Real(-1.118033988749895) * speed * (s1 * s1 - s0 * s0); // even: the same for an edge that moves down
        }
        const Real small = std::min(out[0], 1 - out[0]);
        const Real kept = std::min(std::max(small * per_trim - 1, Real(0)), Real(1));
        out[0] = out[0] < Real(0.5) ? out[0] * kept : 1 - small * kept;
        for (int m = 1; m < moments; m++) out[m] *= kept;
    }
};

// The same of pixel [0, 1] and an edge that moves from p1 to p2.
template <class Real> PALPATE_INLINE void cover(Real p1, Real p2, int moments, Real per_trim, Real* out) {
    const Crossing<Real> edge(p1, p2);
    edge.cover(0, edge.reaches(0), edge.reaches(1), moments, per_trim, out);
}

constexpr double untrimmed = 1e30; // 1 / trim where nothing is trimmed
inline double per(double trim) { return trim > 0 ? 1 / trim : untrimmed; }

// One of `count` Gauss points of a sub-slice's thickness: where it lies in [0, 1], and its Lagrange polynomial in the
// Legendre polynomials of cover().
struct Node {
    double at, share[most_moments];
};
Node gauss(int count, int index);

// Where the edges of the voxels of a sub-slice land along one axis of a parallel image: edge i at offset + slope * i,
// counted so that pixel a is [a, a + 1], when the ray is at the lower [0] and the upper [1] face.
struct Shadow {
    double offset[2], slope[2]; // slope > 0
    double trim;                // see cover
};
enum class Axis { x, y };
Shadow shadow(const Geometry& geometry, const View& view, int z, int sub, Axis axis);

// What the voxels of one slice weigh along one axis of a view's image. The footprint of voxel (z, y, x) in a view is
// the sum over sub-slices and moments of (along y)[y] x (along x)[x], through the resampling if the panel is tilted,
// times path(pixel). Moment 0 is the part of each pixel's width under the shadow of each voxel, averaged over the
// thickness (a trapezoid). Its product is exact if the shadow moves along one axis only; where it moves along both, the
// moves go together, and the higher moments (of either sign) make up for that: the mean over the thickness of a product
// is the sum of the products of Legendre moments. On a turned panel the weights along y differ by column (see Edges)
// and must be cheap: there a product belongs to a Gauss point of the thickness. Along y it takes the weights that hold
// while the ray is there; along x their mean over the thickness, times the point's Lagrange polynomial: the mean of a
// product in which the factor along y is replaced by a polynomial through its values at the points. x and y are those
// that the view sees (View::swapped).
//
// weight[t * n + i] belongs to the pair (i, first[i] + t); entries beyond the other axis are 0. Both directions hold
// the same numbers, so what uses one is the exact transpose of what uses the other.
struct AxisWeights {
    int taps = 0, n = 0;
    std::vector<int32_t> first;
    std::vector<float> weight;
};

// Products of 1-D weights a slice.
inline int products(const View& view) { return view.subs * view.moments; }

// Per voxel along `axis`: the pixels that its shadow touches. product: sub-slice * moments + moment. Along y of a
// turned panel: those of column 0.
void by_voxel(const Geometry& geometry, const View& view, int z, int product, Axis axis, AxisWeights& out);
// Of some voxels only, in ascending order.
void by_voxel(const Geometry& geometry, const View& view, int z, int product, Axis axis, const std::vector<int>& voxels,
              AxisWeights& out);

// Along y on a turned panel: when the ray is at the product's Gauss point, the edge below voxel y lands on row
// at(y, a) of column a, counted so that pixel b is [b, b + 1]; the voxel's weight there is the part of the pixel
// between two edges.
struct Edges {
    double slope, offset;           // in column 0
    double slope_step, offset_step; // from column to column
    double at(double y, double a) const { return (slope + a * slope_step) * y + offset + a * offset_step; }
};
Edges edges(const Geometry& geometry, const View& view, int z, int product);

} // namespace palpate
