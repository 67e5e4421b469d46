#include "bindings/tissue.h"
#include "realtime/timer_jitter.h"
#include "simulation/realtime_loop.h"
#include "simulation/stroke_benchmark.h"
#include <nanobind/stl/array.h>

using namespace nb::literals;
using namespace palpate;

void bind_benchmark(nb::module_& m) {
    m.def(
        "time_stroke",
        [](const TissueModel& model, ModelState& state, const ContactSurface& surface, double radius,
           In<double, 2> points, const std::array<double, 3>& displacement, int ramp, int sweeps, bool prefetch) {
            check_owner(model, state);
            expect_vectors(points, points.shape(0), "points: expected shape (ticks, 3)");
            check_surface(model, surface);
            check_count(sweeps);
            check_radius(radius);
            expect_finite(points, "points: not finite");
            const StrokeTiming out = unlocked([&] {
                return time_stroke(model, state, surface, radius, points.data(), int(points.shape(0)),
                                   displacement.data(), ramp, sweeps, prefetch);
            });
            return nb::make_tuple(copied(out.patch_seconds), copied(out.model_seconds), rows(out.force),
                                  copied(out.stale), copied(out.prefetch_seconds));
        },
        "model"_a, "state"_a, "surface"_a, "radius"_a, "points"_as_is, "displacement"_a, "ramp"_a, "sweeps"_a,
        "prefetch"_a = true,
        nb::sig("def time_stroke(model: palpate._core.tissue.TissueModel, state: palpate._core.tissue.ModelState, "
                "surface: palpate._core.tissue.ContactSurface, radius: float, points: object, "
                "displacement: object, ramp: int, sweeps: int, prefetch: bool = True) -> tuple[typing.Any, ...]"),
        "Ticks by the clock under a patch at (ticks, 3) points: seconds to find each patch and for the model's answer, "
        "forces "
        "(ticks, 3) N, which answers lacked tables, and seconds to prefetch after each. For benchmarks.");
    m.def(
        "timer_jitter",
        [](int ticks, int rate) {
            const TimerJitter out = unlocked([&] { return measure_timer_jitter(ticks, rate); });
            return nb::make_tuple(copied(out.delay), out.missed);
        },
        "ticks"_a, "rate"_a = int(RealtimeLoop::rate),
        nb::sig("def timer_jitter(ticks: int, rate: int = ...) -> tuple[typing.Any, int]"),
        "A thread that does nothing, by the loop's clock: s that each tick began after its deadline, and the number "
        "that missed the next one. The machine's own jitter.");
    m.def(
        "memory_read_jitter",
        [](int ticks, int bytes, int rate) {
            return copied(unlocked([&] { return measure_read_times(ticks, bytes, rate); }));
        },
        "ticks"_a, "bytes"_a, "rate"_a = int(RealtimeLoop::rate),
        nb::sig("def memory_read_jitter(ticks: int, bytes: int, rate: int = ...) -> typing.Any"),
        "A thread that adds up so many bytes each tick, always the same, by the loop's clock: (ticks) s that it took. "
        "How unevenly the machine lets work go on.");
}
