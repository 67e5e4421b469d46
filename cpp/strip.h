#pragma once
#include "bands.h"
#include "turned_rows.h"
#include "walk.h"

namespace palpate {

// Up to eight rows of voxels of one slice that share no pixel, one a lane.
struct Strip {
    int rows = 0;
    int y[lanes];
};

// What the columns say of the voxels of a strip, (planes, lanes, pitch): slope, and coupling with the voxel itself, the
// next one, ... along x, summed over the views.
struct Planes {
    static constexpr int pitch =
        80; // most voxels at once, and not a power of two: planes would share their places in the cache
    int count = 0;
    Buffer values;

    float* of(int plane, int lane) { return values.data() + (plane * lanes + lane) * pitch; }
};

// What a thread needs for one view of a strip.
struct Columns {
    int moments = 0;         // that the strip's rows need
    TurnedRow turned[lanes]; // on turned panels
    Walk walk;               // where the voxels are walked
};

// The footprints of the voxels of one slice in one view whose layout is separable.
class SliceView {
public:
    void make(const Geometry& geometry, const View& view, int z);
    // Moments that the rows of a strip need: see View.
    int moments_of(const Strip& strip) const;
    const Bands& bands(int moments) const { return weights[moments - 1].bands; }

    // What the view says of voxels begin .. end - 1 is added to the planes, or laid out for a walk. columns: with the
    // strip's moments. rows: scratch.
    void gather(const Strip& strip, const float* slope, const float* curvature, int begin, int end, Columns& columns,
                Buffer& rows, Planes& planes) const;
    // slope += curvature · A (change). change: per lane, of voxels begin .. end - 1, Bands::margin() 0s on either side;
    // not read where the voxels are walked.
    void spread(const Strip& strip, const float* const* change, const float* curvature, int begin, int end,
                Columns& columns, Buffer& rows, float* slope) const;

private:
    struct Weights {
        AxisTerms along_y; // unused on turned panels
        Bands bands;       // along x
    };

    // The sums of the columns from .. from + n - 1 under row i of a strip, and back.
    void add_up(const Strip& strip, int i, const float* slope, const float* curvature, int from, int n,
                Columns& columns, float* sums, int64_t pitch) const;
    void hand_back(const Strip& strip, int i, const float* sums, int64_t pitch, const float* curvature, int from, int n,
                   const Columns& columns, float* slope) const;

    const View* view = nullptr;
    int64_t stride = 0;
    std::vector<Weights> weights;     // by moments, for rows that need so many
    std::vector<Edges> along_columns; // turned panels: per term
};

} // namespace palpate
