#include "slide.h"
#include "clock.h"
#include "loop.h"
#include <algorithm>
#include <chrono>
#include <exception>
#include <stdexcept>

namespace palpate {

namespace {

double seconds(std::chrono::steady_clock::duration d) { return std::chrono::duration<double>(d).count(); }

} // namespace

Slide slide(const Model& model, State& state, const Surface& surface, double radius, const double* points, int ticks,
            const double displacement[3], int ramp, int sweeps, bool ahead) {
    using clock = std::chrono::steady_clock;
    auto scratch = surface.scratch();
    Patch patch;
    Slide out;
    out.force.resize(3 * size_t(ticks));
    for (auto* each : {&out.patch_seconds, &out.model_seconds, &out.ahead_seconds}) each->reserve(ticks);
    out.cold.reserve(ticks);
    model.accompany(state);
    auto run = [&] {
        Beat beat(Loop::rate);
        for (int t = 0; t < ticks; t++) {
            const auto began = clock::now();
            const auto found = surface.patch(surface.closest(points + 3 * t), radius, scratch, patch);
            const auto met = clock::now();
            if (found != Surface::Contact::good) break;
            double push[3];
            for (int k = 0; k < 3; k++) push[k] = displacement[k] * std::min(1.0, double(t + 1) / std::max(ramp, 1));
            model.advance(state, &patch, 1, 0, push, sweeps, &out.force[3 * size_t(t)]);
            const auto done = clock::now();
            out.patch_seconds.push_back(seconds(met - began));
            out.model_seconds.push_back(seconds(done - met));
            out.cold.push_back(state.cold);
            if (ahead && t > 0) {
                double next[3];
                for (int k = 0; k < 3; k++) next[k] = 2 * points[3 * t + k] - points[3 * (t - 1) + k];
                if (surface.patch(surface.closest(next), radius, scratch, patch) == Surface::Contact::good)
                    model.expect(state, &patch, 1);
            }
            out.ahead_seconds.push_back(seconds(clock::now() - done));
            beat.wait();
        }
    };
    std::exception_ptr wrong;
    std::thread([&] { // of its own, ahead of others as the loop's is
        try {
            run();
        } catch (...) {
            wrong = std::current_exception();
        }
    })
        .join();
    model.leave(state);
    if (wrong) std::rethrow_exception(wrong);
    if (int(out.cold.size()) < ticks) throw std::invalid_argument("slide: a point without a patch");
    return out;
}

} // namespace palpate
