// Forward and back projection: the system matrix A and its transpose.
// Called by every reconstruction method, from any thread; in parallel over tiles of the result.
#pragma once
#include "projection/scan_geometry.h"

namespace palpate {

// p (views, rows, columns) = A f: line integrals of f (z, y, x), averaged over each pixel. add: p += A f.
void project(const ScanGeometry& geometry, const float* f, float* p, bool add = false);

// f = A' p, the exact transpose.
void backproject(const ScanGeometry& geometry, const float* p, float* f);

} // namespace palpate
