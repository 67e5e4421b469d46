// The two passes of the separable projector in AVX-512 registers, for short sums.
// Forward and back projection call it first, and separable_passes.h where it does not apply.
#pragma once
#include "projection/separable_passes.h"

namespace palpate {

// Does what add_subslice does, and returns true, if the tile needs no more registers than there are.
// prefetch_distance: from a number that is read to one that is needed from memory soon, in floats.
bool add_subslice_avx512(const SourceRows& source, const TileWeights& rows, const ColumnWeights& columns,
                         int64_t prefetch_distance, float* sum);

// Whether the machine has AVX-512 and tests have not switched it off. avx512_span: the most neighbouring elements of
// the source that sixteen columns may read, taps included.
bool avx512_allowed();
constexpr int avx512_span = 32;
void allow_avx512_passes(bool whether); // for tests that compare both passes

} // namespace palpate
