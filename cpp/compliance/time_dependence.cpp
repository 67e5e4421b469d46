// The part of ComplianceModel for tissue whose answer depends on what came before: it relaxes, or has inertia.
#include "compliance/compliance_model.h"
#include <algorithm>

namespace palpate {

// What a force at the end of the tick must do: the displacement from where the tissue would be without it.
void ComplianceModel::subtract_history(ComplianceState& s, int prescribed, double* driving) const {
    double amplitude[VibrationModes::most], free[3];
    if (s.motion) s.motion->free_amplitude(amplitude);
    for (int a = 0; a < prescribed; a++) {
        for (int i = 0; i < s.blocks().count; i++) {
            s.history->free_displacement(i, free);
            for (int k = 0; k < 3; k++) driving[3 * a + k] -= s.weight[a * ContactPatch::capacity + i] * free[k];
        }
        if (!s.motion) continue;
        modes.displacement(s.shape(a), amplitude, free);
        for (int k = 0; k < 3; k++) driving[3 * a + k] -= free[k];
    }
}

// The mean displacement of a patch after the tick.
void ComplianceModel::present_displacement(ComplianceState& s, int patch, double out[3]) const {
    std::fill_n(out, 3, 0.0);
    if (s.motion) {
        double amplitude[VibrationModes::most];
        s.motion->amplitude(amplitude);
        modes.displacement(s.shape(patch), amplitude, out);
    }
    for (int i = 0; i < s.blocks().count; i++) {
        double moved[3];
        s.history->displacement(i, moved);
        for (int k = 0; k < 3; k++) out[k] += s.weight[patch * ContactPatch::capacity + i] * moved[k];
    }
}

// The tick's loads enter the history. If blocks are missing, the patches' vertices are taken to move as their tools do.
void ComplianceModel::advance_history(ComplianceState& s, int prescribed, const double* displacement,
                                      const double* force) const {
    double amplitude[VibrationModes::most], load[VibrationModes::most] = {};
    const size_t stride = 3 * size_t(s.blocks().count);
    std::fill(s.elastic.begin(), s.elastic.end(), 0.0);
    for (size_t k = 0; !s.stale && k < s.samples.size(); k++)
        s.samples[k]->blocks.apply(s.snapshot.load, &s.elastic[stride * k]);
    if (s.stale && s.motion) s.motion->free_amplitude(amplitude);
    for (int i = 0; s.stale && i < s.blocks().count; i++) {
        double sum = 0, mean[3] = {0, 0, 0}, free[3], swing[3] = {0, 0, 0};
        for (int a = 0; a < prescribed; a++) {
            const double w = s.weight[a * ContactPatch::capacity + i];
            sum += w;
            for (int k = 0; k < 3; k++) mean[k] += w * displacement[3 * a + k];
        }
        s.history->free_displacement(i, free);
        if (s.motion) modes.displacement(stiffness.vertex_node[s.blocks().vertex[i]], amplitude, swing);
        for (size_t k = 0; k < 3 * s.samples.size() && sum > 0; k++)
            s.elastic[stride * (k / 3) + 3 * i + k % 3] =
                (mean[k % 3] / sum - free[k % 3] - swing[k % 3]) / recursion.response();
    }
    s.history->advance(s.snapshot.load, s.elastic.data(), !s.stale);
    for (int a = 0; s.motion && a < prescribed; a++)
        for (int m = 0; m < modes.count(); m++)
            for (int k = 0; k < 3; k++) load[m] -= s.shape(a)[3 * m + k] * force[3 * a + k];
    if (s.motion) s.motion->advance(prescribed > 0 ? load : nullptr);
    write_history(s);
}

// The vertices that have loads, those of the contact first, and all numbers of the history.
void ComplianceModel::write_history(ComplianceState& s) const {
    ContactSnapshot& to = s.snapshot;
    const LoadHistory& from = *s.history;
    to.loads = to.count;
    for (int k = 0; k < from.size(); k++)
        if (!from.touched(k)) to.vertex[to.loads++] = from.vertex(k);
    std::fill_n(&to.load[3 * to.count], 3 * (to.loads - to.count), 0.0);
    s.values.resize(ComplianceState::size);
    from.append_to(s.values);
    if (!s.motion) return;
    double amplitude[VibrationModes::most];
    s.motion->amplitude(amplitude);
    to.modes = modes.count();
    std::copy_n(amplitude, to.modes, to.amplitude);
    for (const auto* part : {&s.motion->state, &s.motion->lagging})
        s.values.insert(s.values.end(), part->begin(), part->end());
}

double ComplianceModel::energy(const ModelState& state, int prescribed, const double* displacement,
                               const double* force) const {
    const auto& s = static_cast<const ComplianceState&>(state);
    if (!s.history) {
        const double elastic = TissueModel::energy(state, prescribed, displacement, force);
        return s.gaps ? elastic + gaps.energy(s.gap_force()) : elastic;
    }
    return s.history->energy() + (s.motion ? s.motion->energy() : 0);
}

} // namespace palpate
