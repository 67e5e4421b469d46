// The two passes of the projector on rotated panels, and their weights along x. Called by rotated_panel.cpp.
#pragma once
#include "projection/separable_passes.h"

namespace palpate {

constexpr int rotated_tile_columns = 32; // of a tile; it has tile_rows rows
typedef int32_t ShuffleOrder __attribute__((vector_size(32)));

// The weights along x of one sub-slice for all its Gauss points, for the elements of the result (pixels in forward,
// voxels in back projection), in blocks of tile_size: of(i, points)[(point * taps + t) * tile_size] belongs to
// element first[i] + t of the source, where taps = taps_of(i), 0 if the block has no weight. Within a block `first`
// never falls.
struct ColumnTable {
    std::vector<int32_t> first, taps;
    AlignedBuffer weight;
    int max_taps = 1; // of a block
    const float* of(int i, int points) const {
        return &weight[size_t(i / tile_size) * points * max_taps * tile_size + i % tile_size];
    }
    float* of(int i, int points) {
        return &weight[size_t(i / tile_size) * points * max_taps * tile_size + i % tile_size];
    }
    int taps_of(int i) const { return taps[i / tile_size]; }
};
// slab: slice * subslices + sub-slice.
void forward_column_weights(const ScanGeometry& geometry, const View& view, int slab, ColumnTable& out);
void backprojection_column_weights(const ScanGeometry& geometry, const View& view, int slab, ColumnTable& out);

// Eight neighbouring columns beginning with `a`; those after `last` repeat the last.
struct ColumnOctet {
    double a, last_offset;
    f32x8 ramp;
    ColumnOctet(int a, int last) : a(a), last_offset(std::min(lanes - 1, last - a)) {
        for (int i = 0; i < lanes; i++) ramp[i] = float(std::min(i, last - a));
    }
};

// The most voxels that project onto one of the pixels b0 .. b1 - 1 of those columns.
int voxels_over(const RowEdges& edges, const ColumnOctet& columns, int b0, int b1);

// The most pixels that a voxel projects onto, in a pair of vectors, of which the last may end after na.
constexpr int column_pair = 2 * lanes;
int pixels_under(const RowEdges& edges, int ny, int na);

// out[point][row][0..8] = sum over taps of weight * source[row][first + tap], for `rows` rows of the source and eight
// columns of a tile. gather_voxels does this for any pattern, one element at a time.
void resample_voxels(const float* source, int64_t stride, int rows, const ShufflePattern& reach, int points,
                     const float* weight, int taps, int64_t point_size, float* out);
void gather_voxels(const float* source, int64_t stride, int rows, const int32_t* first, int points, const float* weight,
                   int taps, int64_t point_size, float* out);

// The voxels that project onto pixels of eight columns: from `first` on, the same for all columns. `start` is where
// the upper edge of that voxel lands, counted from the pixel, and `step` its change from column to column.
struct VoxelPositions {
    int32_t first[max_moments][tile_size];
    float start[max_moments][tile_size], step[max_moments][tile_size];
};
// `first` is clamped to low .. high.
void find_voxels(const RowEdges& edges, const ColumnOctet& columns, int b0, int count, int low, int high, int point,
                 VoxelPositions& out);

// sum[row] += sum over points and taps of weight * rows[point][first[row] - begin + tap], rows rotated_tile_columns
// long.
void add_voxels(const float* rows, int64_t point_size, const VoxelPositions& places, const RowEdges* edges,
                const ColumnOctet& columns, int points, int taps, int begin, int count, float* sum);

// out[column] = sum of weight * image over the pixels that voxel y projects onto, for columns begin .. end - 1, in
// pairs of vectors. image: pixel (0, 0), with `taps` rows of 0 before the first row and after the last.
void add_pixels(const RowEdges& edges, int y, int taps, int nb, const float* image, int64_t stride, int begin, int end,
                float* out);

// out[row][0..8] = sum over points and taps of weight * source[point][row][first + tap]; rows of out tile_size long.
void resample_points(const float* source, int64_t stride, int64_t point_size, int rows, const int32_t* first,
                     int columns, int points, const float* weight, int taps, float* out);

} // namespace palpate
