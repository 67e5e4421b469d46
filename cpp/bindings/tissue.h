#pragma once
// What the bindings of all tissue models share: checks of what Python hands over, and the solution of one equilibrium.
#include "bindings/arrays.h"
#include "tissue/contact_surface.h"
#include "tissue/tissue_model.h"
#include <optional>
#include <stdexcept>
#include <vector>

namespace palpate {

inline void check_owner(const TissueModel& model, const ModelState& state) {
    if (!model.owns(state)) throw std::invalid_argument("state: another model's; take one from this model's start()");
}

inline void check_nodes(const TissueModel& model, const std::vector<ContactPatch>& patches) {
    for (const ContactPatch& patch : patches)
        for (int k = 0; k < patch.count; k++)
            if (patch.node[k] < 0 || patch.node[k] >= model.nodes())
                throw std::invalid_argument("patch: names a node that the model does not have");
}

// Of sweeps, iterations or steps: a call cannot be interrupted.
inline void check_count(int sweeps) { expect(within(sweeps, 0, 1'000'000), "sweeps: 0 to 1000000"); }

inline void check_radius(double radius) { expect(within(radius, 0.0, 1e6), "radius: 0 mm or more"); }

// Whether the model has all nodes of the surface.
inline void check_surface(const TissueModel& model, const ContactSurface& surface) {
    for (int node : surface.node) expect(node < model.nodes(), "surface: of another mesh than the model");
}

inline void check_contacts(const TissueModel& model, const ModelState& state, const std::vector<ContactPatch>& patches,
                           const In<double, 2>& displacement) {
    check_owner(model, state);
    check_nodes(model, patches);
    if (displacement.shape(0) != patches.size() || displacement.shape(1) != 3)
        throw std::invalid_argument("displacement: expected shape (contacts, 3)");
}

// Forces on the tools (contacts, 3) N, or nothing.
template <class Model>
std::optional<Owned<double, 2>> solve(const Model& model, ModelState& state, const std::vector<ContactPatch>& patches,
                                      In<double, 2> displacement, int iterations) {
    check_contacts(model, state, patches, displacement);
    check_count(iterations);
    auto force = zeros<double>(patches.size(), 3);
    nb::gil_scoped_release release;
    if (!model.solve(state, patches.data(), int(patches.size()), displacement.data(), iterations, force.data()))
        return std::nullopt;
    return force;
}

} // namespace palpate
