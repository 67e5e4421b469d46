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
            expect(within(patch.node[k], 0, model.nodes() - 1), "patch: names a node that the model does not have");
}

inline void check_elements(const In<double, 2>& nodes, const In<int32_t, 2>& tets, const In<double, 1>& lambda,
                           const In<double, 1>& mu) {
    const size_t elements = tets.shape(0);
    expect(nodes.shape(1) == 3 && tets.shape(1) == 4 && lambda.shape(0) == elements && mu.shape(0) == elements,
           "elements: expected (nodes, 3), (elements, 4), and constants of each element");
    expect_numbers(tets, nodes.shape(0), "tets: names a node that the mesh does not have");
}

// Of sweeps, iterations or steps: a call cannot be interrupted.
inline void check_count(int sweeps) { expect(within(sweeps, 0, 1'000'000), "sweeps: 0 to 1000000"); }

inline void check_radius(double radius) { expect(within(radius, 0.0, 1e6), "radius: 0 mm or more"); }

// Whether the model has all nodes of the surface.
inline void check_surface(const TissueModel& model, const ContactSurface& surface) {
    const std::vector<int>& nodes = surface.carried() ? surface.carrier : surface.node;
    for (int node : nodes) expect(node < model.nodes(), "surface: of another mesh than the model");
}

inline void check_contacts(const TissueModel& model, const ModelState& state, const std::vector<ContactPatch>& patches,
                           const In<double, 2>& displacement) {
    check_owner(model, state);
    check_nodes(model, patches);
    expect_vectors(displacement, patches.size(), "displacement: expected shape (contacts, 3)");
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
