// An organ, whole or cut, as arrays of numbers alone: one memory makes them and another one uses them, so that a page
// factors a cut body in a worker while its session goes on.
#pragma once
#include "compliance/gap_constraints.h"
#include "cutting/cut_body.h"
#include "cutting/cut_skin.h"
#include "linalg/supernodes.h"

namespace palpate {

// The organ before all cuts.
struct OrganSolid {
    std::vector<double> node;         // (nodes, 3) mm
    std::vector<int32_t> tet, region; // (tets, 4), (tets)
    std::vector<double> lam, mu;      // (tets) N/mm^2
    std::vector<uint8_t> fixed;       // (nodes)
    std::vector<int32_t> triangle;    // (triangles, 3) of the outer surface
    std::vector<int> shown;           // nodes that the page shows, ascending
    std::vector<int32_t> regions;     // labels, the largest region first
    double edge = 0;                  // mm, of a mean element
    int nodes() const { return int(fixed.size()); }
    int tets() const { return int(region.size()); }
};

using Cuts = std::vector<std::vector<BladeTriangle>>; // the blade of each

struct BodyArrays {
    Supernodes tree;
    FactorValues<float> factor; // of the stiffness among the free nodes
    GapConstraints gaps;        // between lips
    std::vector<double> node;   // (nodes, 3) mm
    std::vector<uint8_t> fixed; // (nodes)
    std::vector<int> shown;     // nodes that the page shows, ascending
    // Of the surface that tools touch, as ContactSurface takes it.
    std::vector<double> place;     // (vertices, 3) mm
    std::vector<int32_t> triangle; // (triangles, 3)
    std::vector<uint8_t> held;     // (vertices)
    std::vector<int32_t> carrier;  // (vertices, 4) nodes that move it, of a cut body
    std::vector<double> weight;    // (vertices, 4) how much each counts
    // Of a cut body: what is drawn, and what moves it.
    DrawnSkin drawn;
    std::vector<float> rest;     // (drawn vertices, 3) mm
    std::vector<int> drawn_by;   // (drawn vertices, 4) places in `shown`
    std::vector<float> drawn_as; // (drawn vertices, 4) how much each counts
    std::vector<double> area;    // (cuts) mm^2, one lip of each
    std::vector<double> taken;   // mm^3 of the pieces that came free, by region in the order of `regions`
};

// One of its arrays, of whatever type.
struct AnyArray {
    void* data;
    size_t bytes;
    void* vector;
    void* (*resized)(void* vector, size_t bytes); // its data once it has so many
};

// All arrays of a body, always in the same order.
std::vector<AnyArray> arrays_of(BodyArrays& body);

// (nodes) of nodes that are free their number among those, or -1.
std::vector<int> numbered_free(const std::vector<uint8_t>& fixed);

enum Made : int { made, not_positive_definite, comes_free, too_many_gaps }; // what became of a body

// The organ after these cuts, if there are any. Pieces that no three of their nodes hold are taken away. comes_free:
// nothing would be left.
Made make_body(const OrganSolid& solid, const Cuts& cuts, BodyArrays& out);

} // namespace palpate
