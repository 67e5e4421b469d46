#pragma once
#include "passes.h"

namespace palpate {

// add_slice with all that the passes hand on in registers, for tiles that need no more of it than there are: does that,
// or returns false.
bool slide_slice(const Source& source, const Spans& rows, const ColumnSpans& columns, int64_t ahead, float* sum);

// Whether this machine can, and how many neighbours of the source sixteen columns may span, taps included.
bool slides();
constexpr int slide_span = 32;
void allow_sliding(bool whether); // for tests of both ways on one machine

} // namespace palpate
