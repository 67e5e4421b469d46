// The 1-D weights of one sub-slice for one tile of the projector, evaluated where they are needed.
// Called by forward and back projection, on their threads.
#pragma once
#include "base/aligned_buffer.h"
#include "projection/footprint_weights.h"

namespace palpate {

constexpr int tile_size = 64; // elements of the result along an axis of a tile

// Weights along one axis for `count` elements of the result: pixels in forward, voxels in back projection. Up to the
// next multiple of 8 they are padded with weight 0. They are the numbers of AxisWeights, computed anew: tables of a
// whole scan would have to be read from memory.
//
// weight[(moment * taps + t) * tile_size + i] belongs to element first[i] + t of the source, where `first` never
// falls; the weights from t = support[i] on are 0. The elements of the source with any weight are begin .. end - 1;
// `nonempty` tells whether there are any.
struct TileWeights {
    int taps = 0, moments = 0, count = 0, begin = 0, end = 0;
    bool nonempty = false;
    int32_t first[tile_size], support[tile_size];
    AlignedBuffer weight;
};

// Along y: sets the higher moments of the rows that do not need them (View::moments_suffice) to 0, and lowers
// `moments` where none is left. The elements of `out` are rows of pixels, or rows of voxels beginning with `from`.
void drop_moments_of_pixels(const View& view, TileWeights& out);
void drop_moments_of_voxels(const View& view, int from, TileWeights& out);

// The largest number of moments of `tiles` tiles; 0 if all are empty.
int max_moments_of(const TileWeights* rows, int tiles);

// For `count` <= tile_size pixels beginning with `from`: the voxels, of `voxels`, that project onto them.
void forward_weights(const EdgeProjection& shadow, int moments, int from, int count, int voxels, TileWeights& out);

// For `count` <= tile_size voxels beginning with `from`, of `voxels`: the pixels, of `pixels`, that they project
// onto.
void backprojection_weights(const EdgeProjection& shadow, int moments, int from, int count, int voxels, int pixels,
                            TileWeights& out);

} // namespace palpate
