#include "bind.h"
#include "loop.h"
#include "slide.h"
#include <algorithm>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

namespace {

using Vector = std::array<double, 3>;
using Floats = nb::ndarray<nb::numpy, float, nb::ndim<2>>;
using Doubles = nb::ndarray<nb::numpy, double, nb::ndim<2>>;

Vector vector(const double v[3]) { return {v[0], v[1], v[2]}; }

template <class T> struct Column { // a one-dimensional numpy array that owns what it shows
    static nb::ndarray<nb::numpy, T, nb::ndim<1>> from(std::vector<T> values) {
        auto* kept = new std::vector<T>(std::move(values));
        nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
        return {kept->data(), {kept->size()}, owner};
    }
};

template <class T> nb::ndarray<nb::numpy, T, nb::ndim<2>> rows(std::vector<T> values) {
    auto* kept = new std::vector<T>(std::move(values));
    nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
    return {kept->data(), {kept->size() / 3, 3}, owner};
}

struct Driven { // the loop and the surface it looks at
    const Surface& surface;
    Loop loop;
    Driven(const Model& model, const Surface& surface, In<int32_t, 1> shown, const Settings& settings)
        : surface(surface), loop(model, surface, settings, {shown.data(), shown.data() + shown.shape(0)}) {
        if (int at = crowded(settings.radius); at >= 0)
            throw std::invalid_argument("a contact of radius " + std::to_string(settings.radius) +
                                        " mm covers more than " + std::to_string(Patch::capacity) +
                                        " nodes, for example about node " + std::to_string(at));
    }
    int crowded(double radius) const { // a node whose patch would be too big, or -1
        auto scratch = surface.scratch();
        Patch patch;
        for (int t = 0; t < surface.triangles(); t++)
            for (int c = 0; c < 3; c++) {
                int v = surface.corner[3 * t + c];
                Hit at;
                at.triangle = t;
                at.weight[c] = 1;
                std::copy_n(&surface.position[3 * v], 3, at.point);
                if (surface.patch(at, radius, scratch, patch) == Surface::Contact::crowded) return surface.node[v];
            }
        return -1;
    }
};

std::vector<Command> commands(In<bool, 1> held, In<double, 2> points, In<double, 2> displacements) {
    std::vector<Command> all(held.shape(0));
    if (points.shape(0) != all.size() || displacements.shape(0) != all.size() || points.shape(1) != 3 ||
        displacements.shape(1) != 3)
        throw std::invalid_argument("held (n,), points (n, 3), displacements (n, 3)");
    for (size_t i = 0; i < all.size(); i++) {
        all[i].held = held(i);
        for (int k = 0; k < 3; k++) {
            all[i].point[k] = points(i, k);
            all[i].displacement[k] = displacements(i, k);
        }
    }
    return all;
}

nb::tuple drain(Driven& driven) {
    std::vector<Obeyed> obeyed;
    std::vector<Digest> digests;
    std::vector<int64_t> switches;
    driven.loop.switches.drain(switches);
    driven.loop.obeyed.drain(obeyed);
    driven.loop.digests.drain(digests);
    std::vector<int64_t> ticks, digest_ticks;
    std::vector<uint64_t> values;
    std::vector<uint8_t> held;
    std::vector<double> points, displacements;
    for (const auto& [tick, command] : obeyed) {
        ticks.push_back(tick);
        held.push_back(command.held);
        points.insert(points.end(), command.point, command.point + 3);
        displacements.insert(displacements.end(), command.displacement, command.displacement + 3);
    }
    for (const auto& digest : digests) {
        digest_ticks.push_back(digest.ticks);
        values.push_back(digest.value);
    }
    return nb::make_tuple(Column<int64_t>::from(ticks), Column<uint8_t>::from(held), rows(points), rows(displacements),
                          Column<int64_t>::from(digest_ticks), Column<uint64_t>::from(values),
                          Column<int64_t>::from(switches));
}

Doubles step(Driven& driven, Device& device, int64_t ticks) {
    std::vector<double> forces(3 * size_t(ticks));
    {
        nb::gil_scoped_release away;
        driven.loop.step(device, ticks, forces.data());
    }
    return rows(std::move(forces));
}

void bind_devices(nb::module_& m) {
    nb::class_<Device>(m, "Device", "The other end of the loop.");
    nb::class_<Pointer, Device>(m, "Pointer", "Commands from another thread; the newest wins.")
        .def(nb::init<>())
        .def(
            "send",
            [](Pointer& pointer, bool held, Vector point, Vector displacement, int64_t serial) {
                Command command{serial, held, {point[0], point[1], point[2]}, {}};
                for (int k = 0; k < 3; k++) command.displacement[k] = displacement[k];
                pointer.send(command);
            },
            "held"_a, "point"_a, "displacement"_a, "serial"_a = 0, "From one thread only; mm, point at rest.");
    nb::class_<Replay, Device>(m, "Replay", "Commands of a record, each obeyed from its tick on.")
        .def(
            "__init__",
            [](Replay* self, In<int64_t, 1> ticks, In<bool, 1> held, In<double, 2> points, In<double, 2> displacements,
               In<int64_t, 1> switches) {
                new (self) Replay({ticks.data(), ticks.data() + ticks.shape(0)}, commands(held, points, displacements),
                                  {switches.data(), switches.data() + switches.shape(0)});
            },
            "ticks"_a, "held"_a, "points"_a, "displacements"_a, "switches"_a);
}

void bind_frame(nb::module_& m) {
    nb::class_<Frame>(m, "Frame", "What a display needs of one tick; lengths in mm, forces in N.")
        .def_ro("tick", &Frame::tick)
        .def_ro("late", &Frame::late)
        .def_ro("faults", &Frame::faults)
        .def_ro("serial", &Frame::serial)
        .def_ro("seconds", &Frame::seconds)
        .def_ro("busy", &Frame::busy)
        .def_ro("grip", &Frame::grip)
        .def_prop_ro("point", [](const Frame& f) { return vector(f.point); })
        .def_prop_ro("displacement", [](const Frame& f) { return vector(f.displacement); })
        .def_prop_ro("force", [](const Frame& f) { return vector(f.force); })
        .def_prop_ro("pushed", [](const Frame& f) { return vector(f.pushed); })
        .def_prop_ro("shown", [](const Frame& f) { return rows(f.shown); }, nb::rv_policy::automatic);
}

} // namespace

void bind_simulation(nb::module_& m) {
    bind_devices(m);
    bind_frame(m);
    nb::class_<Settings>(m, "Settings", "What a tick does besides the model; mm, N, a tick.")
        .def(nb::init<>())
        .def_rw("sweeps", &Settings::sweeps)
        .def_rw("radius", &Settings::radius)
        .def_rw("limit", &Settings::limit)
        .def_rw("ramp", &Settings::ramp)
        .def_prop_rw(
            "approach", [](const Settings& s) { return s.pace.approach; },
            [](Settings& s, double value) { s.pace.approach = value; })
        .def_prop_rw(
            "reach", [](const Settings& s) { return s.pace.reach; },
            [](Settings& s, double value) { s.pace.reach = value; });
    nb::class_<Driven>(m, "Loop", "A model, a surface and a tool: by the clock (start, stop) or in lockstep (step).")
        .def(nb::init<const Model&, const Surface&, In<int32_t, 1>, const Settings&>(), "model"_a, "surface"_a,
             "shown"_a, "settings"_a, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
        .def(
            "start", [](Driven& d, Device& device) { d.loop.start(device); }, "device"_a, nb::keep_alive<1, 2>())
        .def(
            "stop", [](Driven& d) { d.loop.stop(); }, nb::call_guard<nb::gil_scoped_release>())
        .def_prop_ro("running", [](const Driven& d) { return d.loop.running(); })
        .def("step", &step, "device"_a, "ticks"_a, "(ticks, 3) N")
        .def(
            "fresh", [](const Driven& d) { return d.loop.frames.waiting(); }, "Is there a frame nobody has read?")
        .def(
            "frame", [](Driven& d) { return d.loop.frames.reading(); }, "The newest frame; from one thread only.")
        .def(
            "displacement",
            [](Driven& d) {
                std::vector<double> u(3 * size_t(d.loop.now().nodes()));
                d.loop.now().displacement(u.data());
                return rows(std::move(u));
            },
            "(N, 3) mm; not while it runs")
        .def("drain", &drain, nb::sig("def drain(self) -> tuple[typing.Any, ...]"),
             "Commands obeyed, digests and switches of tables since the last call.")
        .def("dropped", [](const Driven& d) {
            return d.loop.obeyed.dropped() + d.loop.digests.dropped() + d.loop.switches.dropped();
        });
    m.def("sweep_seconds", &sweep_seconds, "model"_a, "surface"_a, "radius"_a,
          "Of the model's sweep, here and now, at best.");
    m.def(
        "slide",
        [](const Model& model, State& state, const Surface& surface, double radius, In<double, 2> points,
           const Vector& displacement, int ramp, int sweeps) {
            if (!model.owns(state)) throw std::invalid_argument("state: another model's");
            if (points.shape(1) != 3) throw std::invalid_argument("points: expected shape (ticks, 3)");
            Slide out;
            {
                nb::gil_scoped_release away;
                out = slide(model, state, surface, radius, points.data(), int(points.shape(0)), displacement.data(),
                            ramp, sweeps);
            }
            return nb::make_tuple(Column<double>::from(out.patch_seconds), Column<double>::from(out.model_seconds),
                                  rows(out.force), Column<uint8_t>::from(out.cold));
        },
        "model"_a, "state"_a, "surface"_a, "radius"_a, "points"_a.noconvert(), "displacement"_a, "ramp"_a, "sweeps"_a,
        nb::sig("def slide(model: Model, state: State, surface: Surface, radius: float, points: object, "
                "displacement: object, ramp: int, sweeps: int) -> tuple[typing.Any, ...]"),
        "Ticks by the clock under a patch at (ticks, 3) points: seconds to find each patch and to answer it, forces "
        "(ticks, 3) N, and which answers lacked tables. For benchmarks.");
    m.attr("RATE") = int(Loop::rate);
    m.attr("DIGEST_TICKS") = int(Loop::digest_ticks);
}
