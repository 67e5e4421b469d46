#include "bind.h"
#include "bind_arrays.h"
#include "empty.h"
#include "loop.h"
#include "slide.h"
#include <nanobind/stl/array.h>

using namespace nb::literals;
using namespace palpate;

void bind_timing(nb::module_& m) {
    m.def("sweep_seconds", &sweep_seconds, "model"_a, "surface"_a, "radius"_a,
          "Of the model's sweep, here and now, at best.");
    m.def(
        "slide",
        [](const Model& model, State& state, const Surface& surface, double radius, In<double, 2> points,
           const std::array<double, 3>& displacement, int ramp, int sweeps, bool ahead) {
            if (!model.owns(state)) throw std::invalid_argument("state: another model's");
            if (points.shape(1) != 3) throw std::invalid_argument("points: expected shape (ticks, 3)");
            Slide out;
            {
                nb::gil_scoped_release away;
                out = slide(model, state, surface, radius, points.data(), int(points.shape(0)), displacement.data(),
                            ramp, sweeps, ahead);
            }
            return nb::make_tuple(OneColumn<double>::from(out.patch_seconds),
                                  OneColumn<double>::from(out.model_seconds), rows(out.force),
                                  OneColumn<uint8_t>::from(out.cold), OneColumn<double>::from(out.ahead_seconds));
        },
        "model"_a, "state"_a, "surface"_a, "radius"_a, "points"_a.noconvert(), "displacement"_a, "ramp"_a, "sweeps"_a,
        "ahead"_a = true,
        nb::sig("def slide(model: Model, state: State, surface: Surface, radius: float, points: object, "
                "displacement: object, ramp: int, sweeps: int, ahead: bool = True) -> tuple[typing.Any, ...]"),
        "Ticks by the clock under a patch at (ticks, 3) points: seconds to find each patch and to answer it, forces "
        "(ticks, 3) N, which answers lacked tables, and seconds to look ahead after each. For benchmarks.");
    m.def(
        "empty_beat",
        [](int ticks, int rate) {
            Empty out;
            {
                nb::gil_scoped_release away;
                out = empty_beat(ticks, rate);
            }
            return nb::make_tuple(OneColumn<double>::from(out.woken), out.late);
        },
        "ticks"_a, "rate"_a = int(Loop::rate),
        nb::sig("def empty_beat(ticks: int, rate: int = ...) -> tuple[typing.Any, int]"),
        "A thread that does nothing, by the loop's clock: s that each tick began after its deadline, and the number "
        "that missed the next one. The machine's own jitter.");
    m.def(
        "reading_beat",
        [](int ticks, int bytes, int rate) {
            std::vector<double> out;
            {
                nb::gil_scoped_release away;
                out = reading_beat(ticks, bytes, rate);
            }
            return OneColumn<double>::from(out);
        },
        "ticks"_a, "bytes"_a, "rate"_a = int(Loop::rate),
        nb::sig("def reading_beat(ticks: int, bytes: int, rate: int = ...) -> typing.Any"),
        "A thread that adds up so many bytes each tick, always the same, by the loop's clock: (ticks) s that it took. "
        "How unevenly the machine lets work go on.");
    m.def("may_wake_promptly", &may_wake_promptly,
          "Does the system let a thread of the loop go ahead of ordinary ones?");
}
