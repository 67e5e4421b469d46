// 1-D weights of separable footprints, and their Legendre moments over the thickness of a sub-slice.
// Source: separable trapezoid footprints after Long, Fessler & Balter, IEEE Trans. Med. Imaging 29:1839 (2010); the
// edges of voxels projected as by De Man & Basu, Phys. Med. Biol. 49:2463 (2004).
// Called by the projector's tiles, the coordinate descent and the tests, on any thread.
#pragma once
#include "base/cpu_dispatch.h"
#include "projection/scan_geometry.h"
#include <algorithm>
#include <cmath>

namespace palpate {

// The projection of a voxel's edge. As the ray crosses a sub-slice, t from 0 to 1, it moves evenly from p1 to p2, in
// pixels. Real is float or double.
template <class Real> struct MovingEdge {
    Real shift, speed, low, inverse_speed;

    PALPATE_INLINE MovingEdge(Real p1, Real p2)
        : shift(p2 - p1), speed(std::max(std::fabs(shift), Real(1e-6))), low(std::min(p1, p2)),
          inverse_speed(1 / speed) {}
    // The t at which an edge that moves upwards reaches the lower end of pixel q, clamped to [0, 1].
    PALPATE_INLINE Real arrival(Real q) const {
        return std::min(std::max((q - low) * inverse_speed, Real(0)), Real(1));
    }
    // The part of pixel [q, q + 1] on the low side of the edge, which is inside the pixel from t0 to t1: its moments
    // with the Legendre polynomials 1, √3 (2t - 1), √5 (6t² - 6t + 1), integrated by parts.
    //
    // Parts below `truncation` are set to 0 and parts above 1 - truncation to 1: the ends of a long trapezoid weigh
    // next to nothing and cost as much as any other pixel. From once to twice `truncation` the moments grow evenly to
    // their value, so that the result is continuous. per_truncation: 1 / truncation, or `no_truncation`.
    PALPATE_INLINE void legendre_moments(Real q, Real t0, Real t1, int moments, Real per_truncation, Real* out) const {
        out[0] = (1 - t1) + (t1 - t0) * (low - q + Real(0.5) * speed * (t0 + t1));
        if (moments > 1)
            out[1] =
                Real(1.7320508075688772) * shift * (t1 * t1 * (Real(0.5) - t1 / 3) - t0 * t0 * (Real(0.5) - t0 / 3));
        if (moments > 2) {
            const Real s0 = t0 * (1 - t0), s1 = t1 * (1 - t1);
            out[2] = Real(-1.118033988749895) * speed * (s1 * s1 - s0 * s0); // even in t: the same for both directions
        }
        const Real small = std::min(out[0], 1 - out[0]);
        const Real fraction = std::min(std::max(small * per_truncation - 1, Real(0)), Real(1));
        out[0] = out[0] < Real(0.5) ? out[0] * fraction : 1 - small * fraction;
        for (int m = 1; m < moments; m++) out[m] *= fraction;
    }
};

// The same for pixel [0, 1] and an edge that moves from p1 to p2.
template <class Real>
PALPATE_INLINE void legendre_moments(Real p1, Real p2, int moments, Real per_truncation, Real* out) {
    const MovingEdge<Real> edge(p1, p2);
    edge.legendre_moments(0, edge.arrival(0), edge.arrival(1), moments, per_truncation, out);
}

constexpr double no_truncation = 1e30; // 1 / truncation where there is none
inline double inverse_truncation(double truncation) { return truncation > 0 ? 1 / truncation : no_truncation; }

// One of `count` Gauss points of a sub-slice's thickness: its position in [0, 1], and the coefficients of its
// Lagrange polynomial, times its weight, in the Legendre polynomials above.
struct GaussPoint {
    double at, coefficient[max_moments];
};
GaussPoint gauss_point(int count, int index);

// The projections of the edges of a sub-slice's voxels along one axis of a parallel image: edge i lands at offset +
// slope * i, where pixel a is [a, a + 1], for rays through the lower face [0] and the upper face [1].
struct EdgeProjection {
    double offset[2], slope[2]; // slope > 0
    double truncation;          // see MovingEdge
};
enum class Axis { x, y };
EdgeProjection project_edges(const ScanGeometry& geometry, const View& view, int z, int sub, Axis axis);

// The weights of the voxels of one slice along one axis of a view's image.
//
// The footprint of voxel (z, y, x) in a view is the sum over sub-slices and moments of (weights along y of voxel y) x
// (weights along x of voxel x), times path(pixel); on an oblique panel it is then resampled. Moment 0 is the part of
// each pixel's width that the voxel's projection covers, averaged over the thickness: a trapezoid. Its product is
// exact if the projection moves along one axis only. If it moves along both, the higher moments correct the product:
// the mean over the thickness of a product is the sum of the products of Legendre moments.
//
// On a rotated panel the weights along y differ by column (see RowEdges) and must be cheap. There a product belongs
// to a Gauss point of the thickness. Its weights along y are those of a ray at that point; its weights along x are
// the mean over the thickness, times the point's Lagrange polynomial. x and y are those of the view (View::swapped).
//
// weight[t * n + i] belongs to voxel i and pixel first[i] + t; entries outside the panel are 0. Forward and back
// projection use the same numbers, so that one is the exact transpose of the other.
struct AxisWeights {
    int taps = 0, n = 0;
    std::vector<int32_t> first;
    std::vector<float> weight;
};

// The number of products of 1-D weights in a slice.
inline int products(const View& view) { return view.subslices * view.moments; }

// For each voxel along `axis`, the pixels that its projection covers. product: sub-slice * moments + moment. Along y
// of a rotated panel: in column 0.
void voxel_weights(const ScanGeometry& geometry, const View& view, int z, int product, Axis axis, AxisWeights& out);
// For some voxels only, in ascending order.
void voxel_weights(const ScanGeometry& geometry, const View& view, int z, int product, Axis axis,
                   const std::vector<int>& voxels, AxisWeights& out);

// Along y on a rotated panel, for a ray at the product's Gauss point: the edge below voxel y lands on row at(y, a) of
// column a, where pixel b is [b, b + 1]. The voxel's weight is the part of the pixel between its two edges.
struct RowEdges {
    double slope, offset;           // in column 0
    double slope_step, offset_step; // from column to column
    double at(double y, double a) const { return (slope + a * slope_step) * y + offset + a * offset_step; }
};
RowEdges row_edges(const ScanGeometry& geometry, const View& view, int z, int product);

} // namespace palpate
