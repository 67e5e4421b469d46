#pragma once
#include "dispatch.h"
#include "geometry.h"
#include <algorithm>
#include <cmath>

namespace palpate {

constexpr int most_moments = 3;

// The part left of a voxel's edge of the pixel [0, 1], while the edge moves from p1 to p2 evenly over the sub-slice's
// thickness t in [0, 1]: its moments with the Legendre polynomials 1, √3 (2t - 1), √5 (6t² - 6t + 1), by parts. Real is
// float or double.
template <class Real> PALPATE_INLINE void cover(Real p1, Real p2, int moments, Real* out) {
    const Real move = p2 - p1, speed = std::max(std::fabs(move), Real(1e-6)), low = std::min(p1, p2), per = 1 / speed;
    const Real t0 = std::min(std::max(-low * per, Real(0)), Real(1)); // between t0 and t1 the edge is on the pixel
    const Real t1 = std::min(std::max((1 - low) * per, Real(0)), Real(1));
    out[0] = (1 - t1) + (t1 - t0) * (low + Real(0.5) * speed * (t0 + t1));
    if (moments > 1)
        out[1] = Real(1.7320508075688772) * move * (t1 * t1 * (Real(0.5) - t1 / 3) - t0 * t0 * (Real(0.5) - t0 / 3));
    if (moments > 2) {
        const Real s0 = t0 * (1 - t0), s1 = t1 * (1 - t1);
        out[2] = Real(-1.118033988749895) * move * (s1 * s1 - s0 * s0);
    }
}

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

// The same numbers per pixel: `count` is the number of pixels along the axis.
void by_pixel(const AxisWeights& voxels, int count, AxisWeights& out);

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
