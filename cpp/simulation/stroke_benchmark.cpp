#include "simulation/stroke_benchmark.h"
#include "realtime/periodic_timer.h"
#include "simulation/realtime_loop.h"
#include <algorithm>
#include <chrono>
#include <exception>
#include <stdexcept>

namespace palpate {

StrokeTiming time_stroke(const TissueModel& model, ModelState& state, const ContactSurface& surface, double radius,
                         const double* points, int ticks, const double displacement[3], int ramp, int sweeps,
                         bool prefetch) {
    using clock = std::chrono::steady_clock;
    auto scratch = surface.scratch();
    ContactPatch patch;
    StrokeTiming out;
    out.force.resize(3 * size_t(ticks));
    for (auto* each : {&out.patch_seconds, &out.model_seconds, &out.prefetch_seconds}) each->reserve(ticks);
    out.stale.reserve(ticks);
    model.begin_realtime(state);
    auto run = [&] {
        PeriodicTimer beat(RealtimeLoop::rate);
        for (int t = 0; t < ticks; t++) {
            const auto began = clock::now();
            const auto found = surface.patch(surface.closest(points + 3 * t), radius, scratch, patch);
            const auto met = clock::now();
            if (found != ContactSurface::PatchStatus::good) break;
            double push[3];
            for (int k = 0; k < 3; k++) push[k] = displacement[k] * std::min(1.0, double(t + 1) / std::max(ramp, 1));
            model.relax(state, &patch, 1, 0, push, sweeps, &out.force[3 * size_t(t)]);
            const auto done = clock::now();
            out.patch_seconds.push_back(seconds(met - began));
            out.model_seconds.push_back(seconds(done - met));
            out.stale.push_back(state.stale);
            if (prefetch && t > 0) {
                double next[3];
                for (int k = 0; k < 3; k++) next[k] = 2 * points[3 * t + k] - points[3 * (t - 1) + k];
                if (surface.patch(surface.closest(next), radius, scratch, patch) == ContactSurface::PatchStatus::good)
                    model.prefetch(state, &patch, 1);
            }
            out.prefetch_seconds.push_back(seconds(clock::now() - done));
            beat.wait();
        }
    };
    std::exception_ptr error;
    std::thread([&] { // with the priority of the loop's
        try {
            run();
        } catch (...) {
            error = std::current_exception();
        }
    })
        .join();
    model.end_realtime(state);
    if (error) std::rethrow_exception(error);
    if (int(out.stale.size()) < ticks) throw std::invalid_argument("time_stroke: a point without a patch");
    return out;
}

} // namespace palpate
