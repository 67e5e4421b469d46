#pragma once
// Times ticks by the clock while a contact slides over the surface. For benchmarks and tests only; on the caller's
// thread and one of its own.
#include "tissue/contact_surface.h"
#include "tissue/tissue_model.h"

namespace palpate {

struct StrokeTiming {
    std::vector<double> patch_seconds, model_seconds; // (ticks): finding the patch; the model's answer
    std::vector<double> prefetch_seconds;             // (ticks): prefetching after the answer
    std::vector<double> force;                        // (ticks, 3) N
    std::vector<uint8_t> stale;                       // (ticks) ModelState::stale
};

// points: (ticks, 3) mm. displacement: mm, reached linearly within the first `ramp` ticks. prefetch: whether the model
// is told between ticks where the patch will be if it goes on as in the last tick.
StrokeTiming time_stroke(const TissueModel& model, ModelState& state, const ContactSurface& surface, double radius,
                         const double* points, int ticks, const double displacement[3], int ramp, int sweeps,
                         bool prefetch);

} // namespace palpate
