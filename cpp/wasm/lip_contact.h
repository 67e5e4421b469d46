// The lips of a cut as constraints of the model, without friction: what Python's palpate.tissue.gap_contact makes.
#pragma once
#include "compliance/gap_constraints.h"
#include "cutting/lip_gaps.h"
#include "linalg/sparse_cholesky.h"

namespace palpate {

// free_index: (nodes) number among the factor's nodes, or -1. vertices: free nodes that are touched or shown. No gaps
// if nothing can meet; more than GapConstraints::most are not taken: `too_many`.
GapConstraints lip_contact(const LipGaps& lips, const SparseCholesky& factor, const std::vector<int>& free_index,
                           const std::vector<int>& vertices, bool& too_many);

} // namespace palpate
