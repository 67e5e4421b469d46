// The part of ComplianceModel that a tissue which relaxes needs beside that of an elastic one.
#include "compliance/compliance_model.h"
#include <algorithm>

namespace palpate {
namespace {

constexpr int capacity = ContactPatch::capacity;

} // namespace

// The displacement from where the tissue would be without a force, times the springs that act at once.
void ComplianceModel::subtract_history(ComplianceState& s, int prescribed, double* driving) const {
    for (int a = 0; a < prescribed; a++)
        for (int i = 0; i < s.blocks.count; i++) {
            double free[3];
            s.history->free_displacement(i, free);
            for (int k = 0; k < 3; k++) driving[3 * a + k] -= s.weight[a * capacity + i] * free[k];
        }
    for (int k = 0; k < 3 * prescribed; k++) driving[k] *= spectrum.instant;
}

// The tick's loads enter the history. If blocks are missing, the patches' vertices are taken to move as their tools do.
void ComplianceModel::remember(ComplianceState& s, int prescribed, const double* displacement) const {
    double elastic[3 * capacity] = {};
    if (!s.stale) s.blocks.apply(s.snapshot.load, elastic);
    for (int i = 0; s.stale && i < s.blocks.count; i++) {
        double sum = 0, mean[3] = {0, 0, 0}, free[3];
        for (int a = 0; a < prescribed; a++) {
            const double w = s.weight[a * capacity + i];
            sum += w;
            for (int k = 0; k < 3; k++) mean[k] += w * displacement[3 * a + k];
        }
        s.history->free_displacement(i, free);
        for (int k = 0; k < 3; k++) elastic[3 * i + k] = sum > 0 ? spectrum.instant * (mean[k] / sum - free[k]) : 0;
    }
    s.history->advance(s.snapshot.load, elastic, !s.stale);
    write_history(s);
}

// The loads for the display, those of the contact first, and all numbers of the history.
void ComplianceModel::write_history(ComplianceState& s) const {
    ContactSnapshot& to = s.snapshot;
    const LoadHistory& from = *s.history;
    for (int i = 0; i < to.count; i++) std::copy_n(from.elastic_load(from.slot_of(to.vertex[i])), 3, &to.load[3 * i]);
    to.loads = to.count;
    for (int k = 0; k < from.size(); k++) {
        if (from.touched(k)) continue;
        to.vertex[to.loads] = from.vertex(k);
        std::copy_n(from.elastic_load(k), 3, &to.load[3 * to.loads++]);
    }
    s.values.resize(ComplianceState::own_numbers);
    from.append_to(s.values);
}

double ComplianceModel::energy(const ModelState& state, int prescribed, const double* displacement,
                               const double* force) const {
    const auto& s = static_cast<const ComplianceState&>(state);
    return s.history ? s.history->energy() : TissueModel::energy(state, prescribed, displacement, force);
}

} // namespace palpate
