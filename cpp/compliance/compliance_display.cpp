// The part of ComplianceModel that gives whole fields: for displays, and for what is asked between ticks.
#include "compliance/compliance_model.h"
#include <algorithm>

namespace palpate {

// What a sample adds to the displacement of all vertices.
const float* ComplianceModel::sample_field(ComplianceState& s, int sample) const {
    GreensFunctions& greens = *s.greens[sample];
    const double* load = acting_loads(s, sample);
    if (!greens.superpose(s.snapshot.vertex, s.snapshot.loads, load, s.part.data()))
        greens.solve(s.snapshot.vertex, s.snapshot.loads, load, s.part.data());
    return s.part.data();
}

void ComplianceModel::displayed_displacement(ModelState& state, const int* nodes, int count, float* out) const {
    if (count == 0) return; // a loop without a display does not pay for the whole field
    auto& s = static_cast<ComplianceState&>(state);
    const ContactSnapshot& at = s.snapshot;
    const bool background = s.tables == TablePolicy::background && s.samples[0]->precompute;
    std::fill(s.field.begin(), s.field.end(), 0.0f);
    for (size_t k = 0; k < s.samples.size() && (background || at.loads > 0); k++) {
        const float* part = background ? s.samples[k]->precompute->newest_field() : sample_field(s, int(k));
        for (size_t i = 0; i < s.field.size(); i++) s.field[i] += part[i];
    }
    if (!background && at.gaps > 0) gaps.add_displacement(at.gap_force, s.field.data());
    for (int i = 0; i < count; i++) {
        const int v = stiffness.vertex_index[nodes[i]];
        for (int k = 0; k < 3; k++) out[3 * i + k] = v < 0 ? 0 : s.field[3 * size_t(v) + k];
        if (v >= 0 && !background && s.motion) modes.add_displacement(nodes[i], at.amplitude, out + 3 * i);
    }
}

void ComplianceModel::displacement(ModelState& state, double* out) const {
    auto& s = static_cast<ComplianceState&>(state);
    const ContactSnapshot& at = s.snapshot;
    std::fill_n(out, 3 * size_t(nodes()), 0.0);
    for (size_t k = 0; k < s.samples.size(); k++) {
        const double* load = acting_loads(s, int(k));
        std::vector<double> x(3 * size_t(samples[k].factor->tree.nodes()), 0);
        for (int v = 0; v < at.loads; v++)
            std::copy_n(load + 3 * v, 3, &x[3 * size_t(stiffness.vertex_free[at.vertex[v]])]);
        if (s.gaps) gaps.add_load(s.gap_force(), x.data());
        samples[k].factor->solve(x.data(), 1);
        for (int i = 0; i < nodes(); i++)
            for (int c = 0; c < 3 && stiffness.free_index[i] >= 0; c++)
                out[3 * size_t(i) + c] += x[3 * size_t(stiffness.free_index[i]) + c];
    }
    if (!s.motion) return;
    double amplitude[VibrationModes::most], moved[3];
    s.motion->amplitude(amplitude);
    for (int i = 0; i < nodes(); i++) {
        modes.displacement(i, amplitude, moved);
        for (int c = 0; c < 3; c++) out[3 * size_t(i) + c] += moved[c];
    }
}

} // namespace palpate
