#pragma once
#include "contact.h"

namespace palpate {

// What ticks by the clock cost and gave, for benchmarks: a patch that slides over the surface, 1000 ticks a second.
struct Slide {
    std::vector<double> patch_seconds, model_seconds; // (ticks): finding the patch, answering it
    std::vector<double> ahead_seconds;                // (ticks): looking ahead, once it was answered
    std::vector<double> force;                        // (ticks, 3) N
    std::vector<uint8_t> cold;                        // (ticks) State::cold
};

// points: (ticks, 3) mm. displacement: mm, reached evenly within the first `ramp` ticks. ahead: between ticks the model
// is told where the patch will be if it goes on as from the tick before.
Slide slide(const Model& model, State& state, const Surface& surface, double radius, const double* points, int ticks,
            const double displacement[3], int ramp, int sweeps, bool ahead);

} // namespace palpate
