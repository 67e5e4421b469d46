// The organ in the page's engine, whole or cut: its stiffness, the model, the surface that tools touch and that is
// shown.
#pragma once
#include "compliance/compliance_model.h"
#include "cutting/cut_body.h"
#include "tissue/contact_surface.h"
#include <memory>

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

// In the order in which each refers to those before.
struct OrganBody {
    std::unique_ptr<SparseCholesky> factor;
    std::unique_ptr<ComplianceModel> model; // none if it cannot be made
    std::unique_ptr<ContactSurface> surface;
    // Of a cut body: what is drawn, and what moves it.
    CutBody cut;
    DrawnSkin drawn;
    std::vector<float> rest;     // (drawn vertices, 3) mm
    double area = 0;             // mm^2, of all cuts, one lip of each
    std::vector<double> taken;   // mm^3 of the pieces that came free, by region in the order of `regions`
    std::vector<int> shown;      // nodes of the body
    std::vector<int> carrier;    // (drawn vertices, 4) places in `shown`, or none: the shown nodes are what is drawn
    std::vector<float> carrying; // (drawn vertices, 4) how much each counts

    bool was_cut() const { return !carrier.empty(); }
    // Displacements of what is drawn, mm, from those of the shown nodes.
    const float* carried(const std::vector<float>& of_nodes, std::vector<float>& out) const;
};

OrganBody whole_body(const OrganSolid& solid);

enum Made : int { made, not_positive_definite, comes_free, too_many_gaps }; // what became of a body

// Of an organ that blades have passed; without a model unless it was made. Pieces that no three of their nodes hold are
// taken away. comes_free: nothing would be left.
OrganBody cut_body_of(const OrganSolid& solid, const std::vector<std::vector<BladeTriangle>>& cuts, Made& answer);

} // namespace palpate
