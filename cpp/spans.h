#pragma once
#include "buffer.h"
#include "weights.h"

namespace palpate {

constexpr int run = 64; // most elements of the result whose weights are made together

// The weights of one sub-slice along one axis, in the direction of the result, for `count` elements of it and up to a
// multiple of 8, the rest with weight 0. The same numbers as AxisWeights, evaluated where they are needed: tables of a
// whole scan would have to be read from memory.
//
// weight[(moment * taps + t) * run + i] belongs to element first[i] + t of the source, first never falls; those from
// t = own[i] on are 0. begin to end are the elements of the source with any weight, `reached` says whether there is
// one.
struct Spans {
    int taps = 0, moments = 0, count = 0, begin = 0, end = 0;
    bool reached = false;
    int32_t first[run], own[run];
    Buffer weight;
};

// Along y, the higher moments of the view's calm rows weigh nothing: takes them out, and lowers `moments` where none is
// left. The elements of out are rows of pixels, or from `from` on of voxels.
void calm_pixels(const View& view, Spans& out);
void calm_voxels(const View& view, int from, Spans& out);

// The most moments of `tiles` Spans one behind the other; 0 if none is reached.
int most_moments_of(const Spans* rows, int tiles);

// For `count` <= run pixels from `from` on: the `voxels` voxels above them.
void over_pixels(const Shadow& shadow, int moments, int from, int count, int voxels, Spans& out);

// For `count` <= run of the `voxels` voxels, from `from` on: those of the `pixels` pixels under them.
void under_voxels(const Shadow& shadow, int moments, int from, int count, int voxels, int pixels, Spans& out);

} // namespace palpate
