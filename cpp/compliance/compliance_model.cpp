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
bool carry_to_spare(ComplianceState::Sample& s, const PatchVertices& to) {
    if (s.blocks.covers(to.vertex, to.count)) return false;
    if (!s.spare_blocks.covers(to.vertex, to.count)) s.spare_blocks.carry_over(s.blocks, to.vertex, to.count);
    return true;
}

// A list in braces would copy the factor.
std::vector<FactoredStiffness> alone(FactoredStiffness one) {
    std::vector<FactoredStiffness> all;
    all.push_back(std::move(one));
    return all;
}

} // namespace

ComplianceState::ComplianceState(const std::vector<FactoredStiffness>& bodies, size_t budget,
                                 const LoadRecursion& recursion, const VibrationModes& modes,
                                 const GapConstraints& constraints)
    : values(size, 0.0), weight(TissueModel::max_patches * capacity), field(3 * size_t(bodies[0].vertices())) {
    for (const FactoredStiffness& body : bodies) {
        samples.push_back(std::make_unique<Sample>(body, budget / bodies.size()));
        greens.push_back(&samples.back()->greens);
    }
    u.assign(3 * size_t(bodies[0].nodes()), 0);
    elastic.resize(3 * samples.size() * capacity), part.resize(field.size());
    if (constraints.count > 0) {
        gaps = std::make_unique<GapSolver>(constraints, TissueModel::max_patches);
        values.resize(size + constraints.numbers());
    }
    if (recursion.fields == 0) return;
    history = std::make_unique<LoadHistory>(bodies[0], recursion);
    acting.resize(3 * ContactSnapshot::capacity);
    if (modes.count() > 0) motion = std::make_unique<ModalMotion>(modes);
    shapes.resize(3 * size_t(modes.count()) * TissueModel::max_patches);
    values.reserve(size + history->most_numbers() + size_t(modes.width + recursion.fields) * modes.count());
}
ComplianceState::~ComplianceState() = default;

bool ComplianceState::blocks_known() const {
    return std::all_of(samples.begin(), samples.end(), [](const auto& one) { return one->blocks.missing == 0; });
}

void ComplianceState::reset() {
    if (history) history->reset();
    if (motion) motion->reset();
    snapshot.count = snapshot.loads = snapshot.gaps = 0;
    values.assign(gaps ? values.size() : size_t(size), 0.0);
    continues = false;
}

ComplianceModel::ComplianceModel(FactoredStiffness s, size_t budget, const RelaxationSpectrum& spectrum)
    : samples(alone(std::move(s))), stiffness(samples[0]), recursion(LoadRecursion::of(spectrum)), budget(budget) {}

ComplianceModel::ComplianceModel(FactoredStiffness s, size_t budget, GapConstraints constraints)
    : samples(alone(std::move(s))), stiffness(samples[0]), gaps(std::move(constraints)), budget(budget) {}

ComplianceModel::ComplianceModel(FactoredStiffness s, size_t budget, VibrationModes vibration)
    : samples(alone(std::move(s))), stiffness(samples[0]), recursion(vibration.loads), modes(std::move(vibration)),
      budget(budget) {}

ComplianceModel::ComplianceModel(std::vector<FactoredStiffness> all, size_t budget, const LoadRecursion& creep)
    : samples(std::move(all)), stiffness(samples.at(0)), recursion(creep), budget(budget) {
    if (int(samples.size()) != creep.samples) throw std::invalid_argument("ComplianceModel: a factor for each sample");
}

std::unique_ptr<ModelState> ComplianceModel::make_state() const {
    auto state = std::make_unique<ComplianceState>(samples, budget, recursion, modes, gaps);
    state->owner = this;
    return state;
}

bool ComplianceModel::relax(ModelState& state, const ContactPatch* patches, int prescribed, int observed,
                            double* displacement, int, double* force) const {
    auto& s = static_cast<ComplianceState&>(state);
    const bool at_rest = (!s.history || s.history->size() == 0) && (!s.motion || s.motion->at_rest);
    s.snapshot.serial++;
    s.energy_shift = 0;
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
        double added[most] = {};
        if (good && s.gaps) close_gaps(s, prescribed, driving, added);
        if (good) apply_stiffness(s, prescribed, driving, added, force);
        if (good && s.history) advance_history(s, prescribed, displacement, force);
        observe(s, prescribed, observed, displacement, force);
    } else {
        release(s);
        std::fill_n(displacement, 3 * observed, 0.0);
        std::fill_n(force, 3 * observed, 0.0);
    }
    if (s.tables == TablePolicy::background) publish_snapshots(s);
    return good;
}

// The loads that a sample's field is due to, at the snapshot's vertices.
const double* ComplianceModel::acting_loads(ComplianceState& s, int sample) const {
    if (!s.history) return s.snapshot.load;
    for (int k = 0; k < s.snapshot.loads; k++)
        s.history->acting_load(s.history->slot_of(s.snapshot.vertex[k]), sample, &s.acting[3 * size_t(k)]);
    return s.acting.data();
}

void ComplianceModel::publish_snapshots(ComplianceState& s) const {
    for (size_t k = 0; k < s.samples.size(); k++) {
        ContactSnapshot& to = s.samples[k]->snapshots.write_slot();
        to.copy(s.snapshot);
        if (s.history) std::copy_n(acting_loads(s, int(k)), 3 * to.loads, to.load);
        s.samples[k]->snapshots.publish();
    }
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
    for (const auto& one : s.samples)
        if (carry_to_spare(*one, vertices)) std::swap(one->blocks, one->spare_blocks);
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
    std::fill_n(s.values.begin(), int(ComplianceState::size), 0.0); // surfaces stick where they did
    s.values[ComplianceState::prescribed_at] = prescribed;
    if (was > n || was == 0) return;
    s.values[ComplianceState::known_at] = before[ComplianceState::known_at];
    for (int i = 0; i < was; i++)
        for (int j = 0; j < was; j++)
            for (int at : {int(ComplianceState::stiffness_at), int(ComplianceState::offset_at)})
                s.values[at + n * i + j] = before[at + was * i + j];
}

void ComplianceModel::release(ComplianceState& s) const {
    std::fill_n(s.values.begin(), ComplianceState::size + gaps.numbers(), 0.0);
    s.snapshot.count = s.snapshot.loads = s.snapshot.gaps = 0;
    s.stale = s.blending = false;
    if (!s.history) return;
    s.history->enter(s.greens.data(), nullptr, 0, false);
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
        for (const auto& one : s.samples)
            if (s.tables != TablePolicy::unavailable) one->blocks.fetch(one->greens);
        const bool fetched = s.tables != TablePolicy::unavailable && s.blocks_known();
        if (!s.history) return fetched;
        return s.history->enter(s.greens.data(), s.blocks().vertex.data(), s.blocks().count, fetched) && fetched;
    };
    s.stale = !known();
    if (!s.stale || s.tables != TablePolicy::on_demand) return;
    compute_missing(s);
    s.stale = !known();
}

// In lockstep: computes the blocks that are missing.
void ComplianceModel::compute_missing(ComplianceState& s) const {
    std::vector<int> vertices(s.blocks().vertex.begin(), s.blocks().vertex.begin() + s.blocks().count);
    for (int k = 0; s.history && k < s.history->size(); k++)
        if (!s.blocks().contains(s.history->vertex(k))) vertices.push_back(s.history->vertex(k));
    double reach = 0;
    for (int v : vertices)
        for (int w : vertices) reach = std::max(reach, stiffness.distance(v, w));
    constexpr size_t batch = GreensFunctions::batch;
    for (GreensFunctions* greens : s.greens) {
        greens->mark_used(vertices.data(), int(vertices.size()));
        std::vector<int> missing;
        for (int v : vertices)
            if (!greens->has_blocks(v, reach)) missing.push_back(v);
        for (size_t k = 0; k < missing.size(); k += batch)
            greens->compute_blocks(&missing[k], int(std::min(batch, missing.size() - k)), 1.25 * reach);
    }
}

// Of two patches, in a tick: sum over the samples of their response times W_a' G_s W_b.
void ComplianceModel::patch_compliance(const ComplianceState& s, int a, int b, double out[9]) const {
    const double *v = &s.weight[a * capacity], *w = &s.weight[b * capacity];
    std::fill_n(out, 9, 0.0);
    for (size_t k = 0; k < s.samples.size(); k++) {
        double part[9];
        a == b ? s.samples[k]->blocks.compliance(v, part) : s.samples[k]->blocks.compliance(v, w, part);
        const double response = recursion.response(int(k));
        for (int c = 0; c < 9; c++) out[c] += response * part[c];
    }
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
            patch_compliance(s, a, b, part);
            if (s.motion) modes.add_compliance(s.shape(a), s.shape(b), part);
            for (int k = 0; k < 9; k++) C[(3 * a + k / 3) * n + 3 * b + k % 3] = part[k];
        }
    if (!invert(C, n, exact)) return false;
    if (values[ComplianceState::known_at] < 0)
        for (int k = 0; k < n * n; k++) offset[k] = in_use[k] - exact[k];
    values[ComplianceState::known_at] = 1;
    s.blending = s.continues || StiffnessBlend::advance(in_use, offset, exact, n, displacement);
    return true;
}

void ComplianceModel::apply_stiffness(ComplianceState& s, int prescribed, const double* displacement,
                                      const double* added, double* force) const {
    double* values = s.values.data();
    const int n = 3 * prescribed;
    for (int k = 0; k < n; k++) {
        force[k] = added[k];
        for (int c = 0; c < n; c++) force[k] -= values[ComplianceState::stiffness_at + n * k + c] * displacement[c];
        values[ComplianceState::force_at + k] = force[k];
        values[ComplianceState::displacement_at + k] = displacement[k];
    }
    const int patches = prescribed > 0 ? prescribed : int(values[ComplianceState::observed_at]);
    s.snapshot.count = s.snapshot.loads = s.blocks().count;
    s.snapshot.gaps = gaps.rows;
    std::copy_n(&values[ComplianceState::size], gaps.rows, s.snapshot.gap_force);
    std::copy_n(s.blocks().vertex.data(), s.blocks().count, s.snapshot.vertex);
    for (int i = 0; i < s.blocks().count; i++) {
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
                patch_compliance(s, o, a, part);
                for (int k = 0; k < 9; k++) mean[k / 3] -= part[k] * force[3 * a + k % 3];
            }
            if (s.gaps) {
                double moved[3];
                s.gaps->set_patch(o, s.blocks().vertex.data(), &s.weight[o * capacity], s.blocks().count);
                s.gaps->patch_displacement(o, s.gap_force(), moved);
                for (int k = 0; k < 3; k++) mean[k] += moved[k];
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
    if (!vertices.gather(stiffness, patches, count)) return;
    for (const auto& one : s.samples)
        if (carry_to_spare(*one, vertices)) one->spare_blocks.fetch(one->greens);
}

void ComplianceModel::begin_realtime(ModelState& state) const {
    auto& s = static_cast<ComplianceState&>(state);
    for (size_t k = 0; k < s.samples.size(); k++) {
        ComplianceState::Sample& one = *s.samples[k];
        one.precompute =
            std::make_unique<PrecomputeThread>(samples[k], one.greens, modes, gaps, looks_ahead, one.snapshots);
    }
    s.tables = TablePolicy::background;
}

void ComplianceModel::end_realtime(ModelState& state) const {
    auto& s = static_cast<ComplianceState&>(state);
    s.tables = TablePolicy::on_demand;
    for (const auto& one : s.samples) one->precompute.reset();
}

} // namespace palpate
