// The part of ComplianceModel that gives whole fields: for displays, and for what is asked between ticks.
#include "compliance/compliance_model.h"
#include <algorithm>

namespace palpate {

void ComplianceModel::displayed_displacement(ModelState& state, const int* nodes, int count, float* out) const {
    auto& s = static_cast<ComplianceState&>(state);
    const ContactSnapshot& at = s.snapshot;
    const float* field = s.field.data();
    if (s.tables == TablePolicy::background && s.precompute)
        field = s.precompute->newest_field();
    else if (at.loads == 0)
        std::fill(s.field.begin(), s.field.end(), 0.0f);
    else if (!s.greens.superpose(at.vertex, at.loads, at.load, s.field.data()))
        s.greens.solve(at.vertex, at.loads, at.load, s.field.data());
    for (int i = 0; i < count; i++) {
        const int v = stiffness.vertex_index[nodes[i]];
        for (int k = 0; k < 3; k++) out[3 * i + k] = v < 0 ? 0 : field[3 * size_t(v) + k];
        if (v >= 0 && field == s.field.data() && s.motion) modes.add_displacement(nodes[i], at.amplitude, out + 3 * i);
    }
}

void ComplianceModel::displacement(ModelState& state, double* out) const {
    const ContactSnapshot& at = static_cast<ComplianceState&>(state).snapshot;
    std::vector<double> x(3 * size_t(stiffness.factor->tree.nodes()), 0);
    for (int k = 0; k < at.loads; k++)
        for (int c = 0; c < 3; c++) x[3 * size_t(stiffness.vertex_free[at.vertex[k]]) + c] = at.load[3 * k + c];
    stiffness.factor->solve(x.data(), 1);
    for (int i = 0; i < nodes(); i++)
        for (int c = 0; c < 3; c++)
            out[3 * size_t(i) + c] = stiffness.free_index[i] < 0 ? 0 : x[3 * size_t(stiffness.free_index[i]) + c];
    const auto& motion = static_cast<ComplianceState&>(state).motion;
    if (!motion) return;
    double amplitude[VibrationModes::most], moved[3];
    motion->amplitude(amplitude);
    for (int i = 0; i < nodes(); i++) {
        modes.displacement(i, amplitude, moved);
        for (int c = 0; c < 3; c++) out[3 * size_t(i) + c] += moved[c];
    }
}

} // namespace palpate
