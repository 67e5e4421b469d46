#pragma once
#include "footprint.h"
#include "lanes.h"

namespace palpate {

constexpr int column_padding = 16; // floats beyond the last column of an image, so that whole vectors fit

// How the descent keeps a view. Where the rows of the image can follow the rows of the volume, a footprint is a small
// box of whole vectors; weights then leave out the length of the ray's path, which the image holds. Elsewhere (tilted
// panels, and panels turned about x) it is a list of measured pixels, and the weights are all.
struct Layout {
    bool boxed;
    int rows, columns;
    int64_t start, down, right; // measured pixel of (0, 0), and steps to the next row and column
    int64_t stride;             // floats from row to row

    explicit Layout(const View& view);
};

// Weights of the voxels of a slice along one axis of an image: voxel i touches pixels first[i] .. first[i] + count[i] -
// 1 in some sub-slice; weight[(i * subs + sub) * width + t], 0 where it does not.
struct PackedAxis {
    int subs = 0, width = 0;
    std::vector<int32_t> first, count;
    std::vector<float> weight;

    // width is rounded up to a multiple of `multiple`; whole vectors stay within `pixels` + column_padding.
    void make(const Geometry& geometry, const View& view, int z, Axis axis, int multiple, int pixels);
    const float* of(int i, int sub) const { return &weight[(size_t(i) * subs + sub) * width]; }
};

// A voxel's footprint: `height` rows of `width` pixels (a multiple of 8, filled up with zeros) from (row, column); or,
// if there are any, `pixels`.
struct Box {
    int row = 0, column = 0, height = 0, width = 0;
    float* weight = nullptr;
    int64_t count = 0;
    const int64_t* pixels = nullptr;
};

// What a thread needs of a view to make the footprints along one row of voxels.
struct RowScratch {
    int taps = 0;
    std::vector<int32_t> low, high; // turned panels, per column: first and last row under the row of voxels
    std::vector<float> column;      // turned panels: weights along y, (subs, taps, stride), tap 0 in row low
    std::vector<double> per_move;
    std::vector<float> weight, sums; // the footprint, and for lists one float a measured pixel, 0 between voxels
    std::vector<int64_t> pixels;
};

// Footprints of the voxels of one slice in one view.
class SliceBoxes {
public:
    void make(const Geometry& geometry, const View& view, int z);
    int rows_apart() const; // rows of voxels this far apart share no pixel, nor does one's box reach into the other's

    // Before the voxels of row y. `all` has been prepared for this slice if the layout is not boxed.
    void begin_row(int y, RowScratch& scratch) const;
    void box(const Footprints& all, int k, int y, int x, RowScratch& scratch, Box& out) const;

private:
    const View* view = nullptr;
    bool boxed = true;
    int64_t stride = 0, measured = 0;
    PackedAxis along_x, along_y; // x, y of the volume; along_y unused on turned panels
    std::vector<Rows> edges;     // turned panels: per sub-slice
    double drift = 0;
    int ny = 0, fine_rows = 1; // fine_rows: of a tilted view's fine panel that one measured pixel touches at most

    void parallel_box(int y, int x, RowScratch& scratch, Box& out) const;
    void turned_box(int x, RowScratch& scratch, Box& out) const;
    void list(const Footprints& all, int k, int y, int x, RowScratch& scratch, Box& out) const;
    double edges_drift() const;
    int turned_rows_apart() const;
};

} // namespace palpate
