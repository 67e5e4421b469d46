// What of a cut organ hangs on nothing, and what of it there is to tell.
#pragma once
#include "wasm/organ_body.h"

namespace palpate {

// (pieces) 1 for those of which no three nodes are held.
std::vector<uint8_t> free_pieces(const VirtualNodes& mesh, const OrganSolid& solid);

// mm^3 of these pieces, by region in the order of `regions`.
std::vector<double> volumes_of(const VirtualNodes& mesh, const std::vector<uint8_t>& pieces, const OrganSolid& solid);

// mm^2 of all cuts, one lip of each.
double cut_area(const CutBody& cut, const OrganSolid& solid);

// The place in `regions` of a tetrahedron's region.
int rank_of(const OrganSolid& solid, int tet);

} // namespace palpate
