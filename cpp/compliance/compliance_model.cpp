#include "compliance/compliance_model.h"
#include "linalg/small_dense.h"
#include "tissue/stiffness_blend.h"
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int capacity = ContactPatch::capacity;
constexpr int most = ComplianceState::most;

// out = a^-1, a 3x3 or larger; overwrites a. False: the contacts are linearly dependent.
bool invert(double* a, int n, double* out) {
    if (n != 3) return invert_positive(a, n, out);
    invert_block(a, out);
    return true;
}

// Makes spare_blocks those of the vertices, unless `blocks` are: then false.
bool carry_to_spare(ComplianceState& s, const PatchVertices& to) {
    if (s.blocks.covers(to.vertex, to.count)) return false;
    if (!s.spare_blocks.covers(to.vertex, to.count)) s.spare_blocks.carry_over(s.blocks, to.vertex, to.count);
    return true;
}

} // namespace

ComplianceState::ComplianceState(const FactoredStiffness& stiffness, size_t budget, const LoadRecursion& recursion,
                                 const VibrationModes& modes)
    : values(size, 0.0), greens(stiffness, budget), weight(TissueModel::max_patches * capacity),
      field(3 * size_t(stiffness.vertices())) {
    u.assign(3 * size_t(stiffness.nodes()), 0);
    if (recursion.fields == 0) return;
    history = std::make_unique<LoadHistory>(stiffness, recursion);
    if (modes.count() > 0) motion = std::make_unique<ModalMotion>(modes);
    shapes.resize(3 * size_t(modes.count()) * TissueModel::max_patches);
    values.reserve(size + history->most_numbers() + size_t(modes.width + recursion.fields) * modes.count());
}
ComplianceState::~ComplianceState() = default;

void ComplianceState::reset() {
    if (history) history->reset();
    if (motion) motion->reset();
    values.assign(size, 0.0);
}

ComplianceModel::ComplianceModel(FactoredStiffness s, size_t budget, const RelaxationSpectrum& spectrum)
    : stiffness(std::move(s)), recursion(LoadRecursion::of(spectrum)), budget(budget) {}

ComplianceModel::ComplianceModel(FactoredStiffness s, size_t budget, VibrationModes vibration)
    : stiffness(std::move(s)), recursion(vibration.loads), modes(std::move(vibration)), budget(budget) {}

std::unique_ptr<ModelState> ComplianceModel::make_state() const {
    auto state = std::make_unique<ComplianceState>(stiffness, budget, recursion, modes);
    state->owner = this;
    return state;
}

bool ComplianceModel::relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed,
                            double* displacement, int, double* force) const {
    auto& s = static_cast<ComplianceState&>(state);
    const bool at_rest = (!s.history || s.history->size() == 0) && (!s.motion || s.motion->at_rest);
    s.snapshot.serial++;
    bool good = true;
    if (prescribed + (at_rest ? 0 : observed) > 0) {
        if (!set_patches(s, patches, prescribed + observed)) return false;
        resize_contacts(s, prescribed);
        s.values[ComplianceState::observed_at] = observed;
        find_blocks(s);
        double driving[most]; // what a force at the end of the tick must do
        std::copy_n(displacement, 3 * prescribed, driving);
        if (s.history) subtract_history(s, prescribed, driving);
        good = update_stiffness(s, prescribed, driving);
        if (good) apply_stiffness(s, prescribed, driving, force);
        if (good && s.history) advance_history(s, prescribed, displacement, force);
        observe(s, prescribed, observed, displacement, force);
    } else {
        release(s);
        std::fill_n(displacement, 3 * observed, 0.0);
        std::fill_n(force, 3 * observed, 0.0);
    }
    if (s.tables == TablePolicy::background) {
        s.snapshots.write_slot().copy(s.snapshot);
        s.snapshots.publish();
    }
    return good;
}

// Takes over the patches and the blocks that they share with those before; false if they have too many nodes together.
bool ComplianceModel::set_patches(ComplianceState& s, const ContactPatch* patches, int count) const {
    PatchVertices vertices;
    if (!vertices.gather(stiffness, patches, count)) return false;
    for (int p = 0; p < count; p++) std::fill_n(&s.weight[p * capacity], vertices.count, 0.0);
    for (int k = 0; k < vertices.entries; k++) {
        const int p = vertices.source[k] / capacity;
        s.weight[p * capacity + vertices.index[k]] = patches[p].weight[vertices.source[k] % capacity];
    }
    if (carry_to_spare(s, vertices)) std::swap(s.blocks, s.spare_blocks);
    for (int p = 0; s.motion && p < count; p++)
        modes.project(patches[p].node, patches[p].weight, patches[p].count, s.shape(p));
    return true;
}

// New contacts come last: the stiffness of those before stays in use. If one goes, the stiffness is dropped.
void ComplianceModel::resize_contacts(ComplianceState& s, int prescribed) const {
    const int was = 3 * int(s.values[ComplianceState::prescribed_at]), n = 3 * prescribed;
    if (was == n) return;
    double before[ComplianceState::size];
    std::copy_n(s.values.begin(), ComplianceState::size, before);
    std::fill(s.values.begin(), s.values.end(), 0.0);
    s.values[ComplianceState::prescribed_at] = prescribed;
    if (was > n || was == 0) return;
    s.values[ComplianceState::known_at] = before[ComplianceState::known_at];
    for (int i = 0; i < was; i++)
        for (int j = 0; j < was; j++)
            for (int at : {int(ComplianceState::stiffness_at), int(ComplianceState::offset_at)})
                s.values[at + n * i + j] = before[at + was * i + j];
}

void ComplianceModel::release(ComplianceState& s) const {
    std::fill_n(s.values.begin(), ComplianceState::size, 0.0);
    s.snapshot.count = s.snapshot.loads = 0;
    s.stale = s.blending = false;
    if (!s.history) return;
    s.history->enter(s.greens, nullptr, 0, false);
    s.history->advance(nullptr, nullptr, true);
    if (s.motion) s.motion->advance(nullptr);
    write_history(s);
}

const double* ComplianceModel::contact_stiffness(const ComplianceState& state) {
    return &state.values[ComplianceState::stiffness_at];
}

// Looks for the blocks between the patches' nodes, and between those and what the history knows of.
void ComplianceModel::find_blocks(ComplianceState& s) const {
    const auto known = [&] {
        if (s.tables != TablePolicy::unavailable) s.blocks.fetch(s.greens);
        const bool fetched = s.tables != TablePolicy::unavailable && s.blocks.missing == 0;
        if (!s.history) return fetched;
        return s.history->enter(s.greens, s.blocks.vertex.data(), s.blocks.count, fetched) && fetched;
    };
    s.stale = !known();
    if (!s.stale || s.tables != TablePolicy::on_demand) return;
    compute_missing(s);
    s.stale = !known();
}

// In lockstep: computes the blocks that are missing.
void ComplianceModel::compute_missing(ComplianceState& s) const {
    std::vector<int> vertices(s.blocks.vertex.begin(), s.blocks.vertex.begin() + s.blocks.count);
    for (int k = 0; s.history && k < s.history->size(); k++)
        if (!s.blocks.contains(s.history->vertex(k))) vertices.push_back(s.history->vertex(k));
    double reach = 0;
    for (int v : vertices)
        for (int w : vertices) reach = std::max(reach, stiffness.distance(v, w));
    s.greens.mark_used(vertices.data(), int(vertices.size()));
    std::vector<int> missing;
    for (int v : vertices)
        if (!s.greens.has_blocks(v, reach)) missing.push_back(v);
    constexpr size_t batch = GreensFunctions::batch;
    for (size_t k = 0; k < missing.size(); k += batch)
        s.greens.compute_blocks(&missing[k], int(std::min(batch, missing.size() - k)), 1.25 * reach);
}

// The exact stiffness plus what is left of its difference to the last one; if blocks are missing, the last one.
bool ComplianceModel::update_stiffness(ComplianceState& s, int prescribed, const double* displacement) const {
    double* values = s.values.data();
    double *in_use = values + ComplianceState::stiffness_at, *offset = values + ComplianceState::offset_at;
    if (s.stale) {
        values[ComplianceState::known_at] = -1;
        s.blending = true;
        return true;
    }
    if (prescribed == 0) return true;
    const int n = 3 * prescribed;
    double C[most * most], exact[most * most], part[9];
    for (int a = 0; a < prescribed; a++)
        for (int b = 0; b <= a; b++) {
            const double *v = &s.weight[a * capacity], *w = &s.weight[b * capacity];
            a == b ? s.blocks.compliance(v, part) : s.blocks.compliance(v, w, part);
            for (int k = 0; s.history && k < 9; k++) part[k] *= recursion.drive[0];
            if (s.motion) modes.add_compliance(s.shape(a), s.shape(b), part);
            for (int k = 0; k < 9; k++) C[(3 * a + k / 3) * n + 3 * b + k % 3] = part[k];
        }
    if (!invert(C, n, exact)) return false;
    if (values[ComplianceState::known_at] < 0)
        for (int k = 0; k < n * n; k++) offset[k] = in_use[k] - exact[k];
    values[ComplianceState::known_at] = 1;
    s.blending = StiffnessBlend::advance(in_use, offset, exact, n, displacement);
    return true;
}

void ComplianceModel::apply_stiffness(ComplianceState& s, int prescribed, const double* displacement,
                                      double* force) const {
    double* values = s.values.data();
    const int n = 3 * prescribed;
    for (int k = 0; k < n; k++) {
        force[k] = 0;
        for (int c = 0; c < n; c++) force[k] -= values[ComplianceState::stiffness_at + n * k + c] * displacement[c];
        values[ComplianceState::force_at + k] = force[k];
        values[ComplianceState::displacement_at + k] = displacement[k];
    }
    const int patches = prescribed > 0 ? prescribed : int(values[ComplianceState::observed_at]);
    s.snapshot.count = s.snapshot.loads = s.blocks.count;
    std::copy_n(s.blocks.vertex.data(), s.blocks.count, s.snapshot.vertex);
    for (int i = 0; i < s.blocks.count; i++) {
        double sum = 0, load[3] = {0, 0, 0};
        for (int a = 0; a < patches; a++) {
            const double w = s.weight[a * capacity + i];
            sum += w;
            for (int k = 0; k < 3 && a < prescribed; k++) load[k] -= w * force[3 * a + k];
        }
        s.snapshot.weight[i] = sum / patches;
        std::copy_n(load, 3, &s.snapshot.load[3 * i]);
    }
}

// The displacement of observed patches: their compliance with the prescribed ones times the forces. If blocks are
// missing, the last displacement.
void ComplianceModel::observe(ComplianceState& s, int prescribed, int observed, double* displacement,
                              double* force) const {
    double* values = s.values.data();
    for (int o = prescribed; o < prescribed + observed; o++) {
        double* mean = values + ComplianceState::displacement_at + 3 * o;
        if (!s.stale && s.history) {
            present_displacement(s, o, mean);
        } else if (!s.stale) {
            std::fill_n(mean, 3, 0.0);
            for (int a = 0; a < prescribed; a++) {
                double part[9];
                s.blocks.compliance(&s.weight[o * capacity], &s.weight[a * capacity], part);
                for (int k = 0; k < 9; k++) mean[k / 3] -= part[k] * force[3 * a + k % 3];
            }
        }
        std::copy_n(mean, 3, displacement + 3 * o);
        std::fill_n(force + 3 * o, 3, 0.0);
    }
}

// A vertex that enters a patch brings some twenty tables that are in no cache: reads them between ticks.
void ComplianceModel::prefetch(ModelState& state, const ContactPatch* patches, int count) const {
    auto& s = static_cast<ComplianceState&>(state);
    PatchVertices vertices;
    if (vertices.gather(stiffness, patches, count) && carry_to_spare(s, vertices)) s.spare_blocks.fetch(s.greens);
}

void ComplianceModel::begin_realtime(ModelState& state) const {
    auto& s = static_cast<ComplianceState&>(state);
    s.precompute = std::make_unique<PrecomputeThread>(stiffness, s.greens, modes, s.snapshots);
    s.tables = TablePolicy::background;
}

void ComplianceModel::end_realtime(ModelState& state) const {
    auto& s = static_cast<ComplianceState&>(state);
    s.tables = TablePolicy::on_demand;
    s.precompute.reset();
}

} // namespace palpate
