// The part of ComplianceModel for surfaces that may meet, and for a body that takes the place of another one.
#include "compliance/compliance_model.h"

namespace palpate {
namespace {

constexpr int gap_sweeps = 8, first_sweeps = 60; // a tick starts where the last one has come to

} // namespace

// The forces in the gaps, and what they add to those of the tissue on the tools. They are found with the exact
// stiffness: with the one in use they could have no solution.
void ComplianceModel::close_gaps(ComplianceState& s, int prescribed, const double* displacement, double* added) const {
    const int n = 3 * prescribed;
    if (s.stale && s.continues) return; // the forces before the cut serve on
    double *in_use = &s.values[ComplianceState::stiffness_at], *offset = &s.values[ComplianceState::offset_at];
    constexpr int most = ComplianceState::most;
    double exact[most * most], moved[most];
    for (int k = 0; k < n * n; k++) exact[k] = in_use[k] - offset[k];
    for (int a = 0; a < prescribed; a++)
        s.gaps->set_patch(a, s.blocks().vertex.data(), &s.weight[a * ContactPatch::capacity], s.blocks().count);
    s.energy_shift = -s.gaps->solve(exact, displacement, n, s.continues ? first_sweeps : gap_sweeps, s.gap_force());
    for (int a = 0; a < prescribed; a++) s.gaps->patch_displacement(a, s.gap_force(), moved + 3 * a);
    double square = 0;
    for (int k = 0; k < n; k++) {
        square += displacement[k] * displacement[k];
        for (int c = 0; c < n; c++) added[k] += exact[n * k + c] * moved[c];
    }
    if (s.continues && square > 0) // no step: the difference fades with that of the stiffness
        for (int k = 0; k < n * n; k++) {
            const double part = added[k / n] * displacement[k % n] / square;
            in_use[k] += part, offset[k] += part;
        }
    s.continues = false;
}

// The stiffness in use serves on; its difference to that of the cut body fades out once the blocks of that are known.
bool ComplianceModel::continue_from(ModelState& state, const ModelState& from) const {
    const auto* other = dynamic_cast<const ComplianceState*>(&from);
    auto& s = static_cast<ComplianceState&>(state);
    if (!other || s.history || other->history) return false;
    std::copy_n(other->values.data(), int(ComplianceState::size), s.values.data());
    s.values[ComplianceState::known_at] = -1;
    s.continues = s.gaps != nullptr;
    // What forces in gaps of the body before added to those of the tools is part of the stiffness now.
    const int n = 3 * int(s.values[ComplianceState::prescribed_at]);
    double *in_use = &s.values[ComplianceState::stiffness_at], square = 0;
    const double *d = &s.values[ComplianceState::displacement_at], *force = &s.values[ComplianceState::force_at];
    for (int k = 0; k < n; k++) square += d[k] * d[k];
    for (int k = 0; other->gaps && k < n && square > 0; k++) {
        double missing = -force[k];
        for (int c = 0; c < n; c++) missing -= in_use[n * k + c] * d[c];
        for (int c = 0; c < n; c++) in_use[n * k + c] += missing * d[c] / square;
    }
    return true;
}

bool ComplianceModel::contact_slope(const ModelState& state, int patch, double* out) const {
    const auto& s = static_cast<const ComplianceState&>(state);
    if (s.gaps) return false; // forces in the gaps add to it
    const int n = 3 * int(s.values[ComplianceState::prescribed_at]);
    for (int k = 0; k < 9; k++) out[k] = contact_stiffness(s)[n * (3 * patch + k / 3) + 3 * patch + k % 3];
    return true;
}

} // namespace palpate
