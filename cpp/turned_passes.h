#pragma once
#include "passes.h"

namespace palpate {

constexpr int breadth = 32; // columns of a tile; it has `height` rows
typedef int32_t Order __attribute__((vector_size(32)));

// The weights along x of one sub-slice for all its Gauss points, in the direction of the result, in blocks of `run`
// elements: of(i, points)[(point * taps + t) * run] belongs to element first[i] + t of the source, where taps is that
// of the block, 0 if it has no weight. In a block first never falls.
struct ColumnTable {
    std::vector<int32_t> first, taps;
    Buffer weight;
    int most = 1; // taps of a block
    const float* of(int i, int points) const { return &weight[size_t(i / run) * points * most * run + i % run]; }
    float* of(int i, int points) { return &weight[size_t(i / run) * points * most * run + i % run]; }
    int taps_of(int i) const { return taps[i / run]; }
};
// slab: slice * subs + sub-slice
void over_columns(const Geometry& geometry, const View& view, int slab, ColumnTable& out);
void under_columns(const Geometry& geometry, const View& view, int slab, ColumnTable& out);

// Eight neighbouring columns from `a` on, of which those beyond `last` stand for the last.
struct Eight {
    double a, behind;
    Lanes ramp;
    Eight(int a, int last) : a(a), behind(std::min(lanes - 1, last - a)) {
        for (int i = 0; i < lanes; i++) ramp[i] = float(std::min(i, last - a));
    }
};

// The most voxels over one of the pixels b0 to b1 of those columns.
int voxels_over(const Edges& edges, const Eight& columns, int b0, int b1);

// The most pixels under one voxel.
constexpr int pair = 2 * lanes;
int pixels_under(const Edges& edges, int ny, int na); // in a pair of vectors, of which the last may go beyond na

// out[point][row][0..8] = sum over taps of weight * source[row][first + tap], for `rows` rows of the source and eight
// columns of a tile. gather_voxels does any reach, one by one.
void resample_voxels(const float* source, int64_t stride, int rows, const Reach& reach, int points, const float* weight,
                     int taps, int64_t point_size, float* out);
void gather_voxels(const float* source, int64_t stride, int rows, const int32_t* first, int points, const float* weight,
                   int taps, int64_t point_size, float* out);

// The voxels over each of some pixels of eight columns: from first on, the same for all columns.
struct Places {
    int32_t first[most_moments][run];
    float start[most_moments][run], step[most_moments][run]; // where the upper edge of voxel `first` lands, and its
                                                             // change from column to column, counted from the pixel
};
// first lies from low to high.
void place_voxels(const Edges& edges, const Eight& columns, int b0, int count, int low, int high, int point,
                  Places& out);

// sum[row] += sum over points and taps of weight * rows[point][first[row] - begin + tap], rows `breadth` long.
void add_voxels(const float* rows, int64_t point_size, const Places& places, const Edges* edges, const Eight& columns,
                int points, int taps, int begin, int count, float* sum);

// out[column] = sum of weight * image over the pixels under voxel y, for columns from `begin` to `end`, in whole pairs.
// image: pixel (0, 0), with `taps` rows of 0 above it and below row nb.
void add_pixels(const Edges& edges, int y, int taps, int nb, const float* image, int64_t stride, int begin, int end,
                float* out);

// out[row][0..8] = sum over points and taps of weight * source[point][row][first + tap]; rows of out `run` long.
void resample_points(const float* source, int64_t stride, int64_t point_size, int rows, const int32_t* first,
                     int columns, int points, const float* weight, int taps, float* out);

} // namespace palpate
