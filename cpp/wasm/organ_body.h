// The organ in the page's engine, whole or cut: the model, the surface that tools touch and what is shown.
#pragma once
#include "compliance/compliance_model.h"
#include "tissue/contact_surface.h"
#include "wasm/body_arrays.h"
#include <memory>

namespace palpate {

struct OrganBody {
    explicit OrganBody(BodyArrays arrays);
    OrganBody(const OrganBody&) = delete; // the model refers into it

    BodyArrays arrays; // without factor and gaps, which the model has
    std::unique_ptr<ComplianceModel> model;
    std::shared_ptr<const ContactSurface> surface; // which a blade keeps on its way, while pieces of its cut open
    double area = 0;                               // mm^2, of all cuts, one lip of each

    bool was_cut() const { return !arrays.drawn_by.empty(); }
    // Displacements of what is drawn, mm, from those of the shown nodes.
    const float* drawn(const std::vector<float>& of_nodes, std::vector<float>& out) const;
};

} // namespace palpate
