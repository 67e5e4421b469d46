// Pieces of a slit mesh that hang on nothing.
#pragma once
#include "cutting/slit_parts.h"

namespace palpate {

// Marks as gone the parts of each body that has no three held nodes which are not on one line. held: (node_count).
void take_free_pieces(SlitComplex& slit, const SlitParts& parts, const uint8_t* held, int node_count);

} // namespace palpate
