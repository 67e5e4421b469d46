#pragma once
#include "dispatch.h"
#include "geometry.h"
#include "weights.h"
#include <cstring>

namespace palpate {

// Eight floats in one register (or two): sums stay in fixed lanes, so their order is the same for any instruction set.
typedef float Lanes __attribute__((vector_size(32)));
constexpr int lanes = 8;
constexpr int column_padding = 16; // floats beyond the last column of an image, so that whole vectors fit
PALPATE_INLINE void load(Lanes& v, const float* p) { std::memcpy(&v, p, sizeof v); }
PALPATE_INLINE void store(float* p, const Lanes& v) { std::memcpy(p, &v, sizeof v); }
PALPATE_INLINE float total(const Lanes& v) {
    return ((v[0] + v[4]) + (v[1] + v[5])) + ((v[2] + v[6]) + (v[3] + v[7]));
}

// Weights of the voxels of a slice along one axis: voxel i touches pixels first[i] .. first[i] + count[i] - 1 in some
// sub-slice; weight[(i * subs + sub) * width + t], 0 where it does not.
struct PackedAxis {
    int subs = 0, width = 0;
    std::vector<int32_t> first, count;
    std::vector<float> weight;

    // width is rounded up to a multiple of `multiple`.
    void make(const Geometry& geometry, const View& view, int z, Axis axis, int multiple);
    const float* of(int i, int sub) const { return &weight[(size_t(i) * subs + sub) * width]; }
};

// A voxel's footprint on one image: `height` rows of `width` pixels (a multiple of 8, filled up with zeros) from (row,
// column), weights without the length of the ray's path.
struct Box {
    int row = 0, column = 0, height = 0, width = 0;
    float* weight = nullptr;
};

// Footprints of the voxels of one slice in one view, on the image on which the descent keeps that view: the parallel
// panel itself, or the measured one if that is tilted.
class SliceFootprints {
public:
    void make(const Geometry& geometry, const View& view, int z);
    int rows_apart() const; // rows of voxels this far apart share no pixel
    int64_t capacity() const; // floats of the largest box

    // weight: room for capacity() floats. scratch: for tilted panels, one float a measured pixel, all 0 before and after.
    void box(int y, int x, float* weight, float* scratch, Box& out) const {
        if (view->resampled)
            tilted(y, x, weight, scratch, out);
        else
            parallel_panel(y, x, weight, out);
    }

private:
    const View* view = nullptr;
    PackedAxis along_x, along_y;
    double seen[9];    // homography: (column, row) of the fine panel to (row, column) of the tilted one
    int fine_rows = 1; // rows of the fine panel that one measured pixel touches at most

    void parallel_panel(int y, int x, float* weight, Box& out) const;
    void tilted(int y, int x, float* weight, float* scratch, Box& out) const;
    void tilted_bounds(int y, int x, int bounds[4]) const;
};

} // namespace palpate
