#include "wasm/organ_body.h"
#include <numeric>

namespace palpate {
namespace {

constexpr size_t table_bytes = size_t(256) << 20; // of the compliance's tables, as in Python

std::unique_ptr<ComplianceModel> model_of(BodyArrays& body) {
    const std::vector<int> free_index = numbered_free(body.fixed);
    std::vector<int> vertices;
    for (int i : body.shown)
        if (free_index[i] >= 0) vertices.push_back(i);
    GapConstraints& gaps = body.gaps;
    gaps.count = gaps.rows = int(gaps.rest.size());
    gaps.stride = gaps.count > 0 ? int(gaps.between.size()) / gaps.count : 0;
    FactoredStiffness stiffness =
        factored_stiffness(body.tree, nullptr, std::move(body.factor), free_index, vertices, body.node.data());
    if (gaps.count == 0) return std::make_unique<ComplianceModel>(std::move(stiffness), table_bytes);
    return std::make_unique<ComplianceModel>(std::move(stiffness), table_bytes, std::move(gaps));
}

std::shared_ptr<ContactSurface> surface_of(const BodyArrays& body) {
    const int vertices = int(body.held.size());
    auto out = std::make_shared<ContactSurface>(body.place.data(), vertices, body.triangle.data(),
                                                int(body.triangle.size() / 3), body.held.data());
    if (!body.carrier.empty())
        out->carry(body.carrier.data(), body.weight.data(), vertices, body.fixed.data(), int(body.fixed.size()));
    return out;
}

} // namespace

OrganBody::OrganBody(BodyArrays given)
    : arrays(std::move(given)), model(model_of(arrays)), surface(surface_of(arrays)),
      area(std::accumulate(arrays.area.begin(), arrays.area.end(), 0.0)) {}

const float* OrganBody::drawn(const std::vector<float>& of_nodes, std::vector<float>& out) const {
    if (!was_cut()) return of_nodes.data();
    out.assign(arrays.rest.size(), 0);
    for (size_t k = 0; k < arrays.drawn_by.size(); k++)
        for (int d = 0; d < 3; d++)
            out[3 * (k / 4) + d] += arrays.drawn_as[k] * of_nodes[3 * size_t(arrays.drawn_by[k]) + d];
    return out.data();
}

} // namespace palpate
