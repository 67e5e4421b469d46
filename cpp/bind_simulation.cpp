#include "bind.h"
#include "bind_arrays.h"
#include "handed.h"
#include "loop.h"
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
using Forces = nb::ndarray<nb::numpy, double, nb::ndim<3>>;

Vector vector(const double v[3]) { return {v[0], v[1], v[2]}; }

struct Driven { // the loop and the surface it looks at
    const Surface& surface;
    Loop loop;
    Driven(const Model& model, const Surface& surface, In<int32_t, 1> shown, const Settings& settings)
        : surface(surface), loop(model, surface, settings, {shown.data(), shown.data() + shown.shape(0)}) {
        if (int at = crowded(settings.manner.radius); at >= 0)
            throw std::invalid_argument("a contact of radius " + std::to_string(settings.manner.radius) +
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

Command::Kind kind(int number) {
    if (number < 0 || number > int(Command::Kind::free)) throw std::invalid_argument("kind: 0 to 3");
    return Command::Kind(number);
}

std::vector<Command> commands(In<uint8_t, 1> kinds, In<double, 2> points, In<double, 2> displacements) {
    std::vector<Command> all(kinds.shape(0));
    if (points.shape(0) != all.size() || displacements.shape(0) != all.size() || points.shape(1) != 3 ||
        displacements.shape(1) != 3)
        throw std::invalid_argument("kinds (n,), points (n, 3), displacements (n, 3)");
    for (size_t i = 0; i < all.size(); i++) {
        all[i].kind = kind(kinds(i));
        for (int k = 0; k < 3; k++) {
            all[i].point[k] = points(i, k);
            all[i].displacement[k] = displacements(i, k);
        }
    }
    return all;
}

std::vector<uint8_t> tool_numbers(In<uint8_t, 1> tools, size_t count) {
    if (tools.shape(0) != count) throw std::invalid_argument("tools: one for each command");
    for (size_t i = 0; i < count; i++)
        if (tools(i) >= most_tools) throw std::invalid_argument("tools: less than " + std::to_string(most_tools));
    return {tools.data(), tools.data() + count};
}

nb::tuple drain(Driven& driven) {
    std::vector<Obeyed> obeyed;
    std::vector<Digest> digests;
    std::vector<Switch> switches;
    driven.loop.switches.drain(switches);
    driven.loop.obeyed.drain(obeyed);
    driven.loop.digests.drain(digests);
    std::vector<int64_t> ticks, digest_ticks;
    std::vector<uint64_t> values;
    std::vector<uint8_t> tools, kinds, lacking;
    std::vector<int64_t> switch_ticks;
    std::vector<double> points, displacements;
    for (const auto& [tick, tool, command] : obeyed) {
        ticks.push_back(tick);
        tools.push_back(uint8_t(tool));
        kinds.push_back(uint8_t(command.kind));
        points.insert(points.end(), command.point, command.point + 3);
        displacements.insert(displacements.end(), command.displacement, command.displacement + 3);
    }
    for (const auto& digest : digests) {
        digest_ticks.push_back(digest.ticks);
        values.push_back(digest.value);
    }
    for (const auto& change : switches) {
        switch_ticks.push_back(change.tick);
        lacking.push_back(uint8_t(change.lacking));
    }
    return nb::make_tuple(OneColumn<int64_t>::from(ticks), OneColumn<uint8_t>::from(tools),
                          OneColumn<uint8_t>::from(kinds), rows(points), rows(displacements),
                          OneColumn<int64_t>::from(digest_ticks), OneColumn<uint64_t>::from(values),
                          OneColumn<int64_t>::from(switch_ticks), OneColumn<uint8_t>::from(lacking));
}

nb::list drain_changes(Driven& driven) { // (tick, model)
    std::vector<Changed> changes;
    driven.loop.changes.drain(changes);
    nb::list out;
    for (const auto& [tick, model] : changes) out.append(nb::make_tuple(tick, nb::find(model)));
    return out;
}

Forces step(Driven& driven, Device& device, int64_t ticks) {
    constexpr size_t tools = most_tools;
    auto* forces = new std::vector<double>(3 * tools * size_t(ticks));
    nb::capsule owner(forces, [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
    {
        nb::gil_scoped_release away;
        driven.loop.step(device, ticks, forces->data());
    }
    return {forces->data(), {size_t(ticks), tools, 3}, owner};
}

std::vector<int> grips(const Frame& f) { return {f.grip, f.grip + most_tools}; }
std::vector<Vector> vectors(const double* v) { // of each tool
    std::vector<Vector> out;
    for (int t = 0; t < most_tools; t++) out.push_back(vector(v + 3 * t));
    return out;
}

void bind_devices(nb::module_& m) {
    nb::class_<Device>(m, "Device", "The other end of the loop.");
    nb::class_<Pointer, Device>(m, "Pointer", "Commands from another thread; the newest wins.")
        .def(nb::init<>())
        .def(
            "send",
            [](Pointer& pointer, int tool, int number, Vector point, Vector displacement, int64_t serial) {
                if (tool < 0 || tool >= most_tools) throw std::invalid_argument("tool: 0 to 3");
                Command command{kind(number), {point[0], point[1], point[2]}, {}};
                for (int k = 0; k < 3; k++) command.displacement[k] = displacement[k];
                pointer.send(tool, command, serial);
            },
            "tool"_a, "kind"_a, "point"_a, "displacement"_a, "serial"_a = 0, "From one thread only; mm.");
    nb::class_<Handed, Device>(m, "Handed", "A device with motors: a tool in space; its button holds.")
        .def(nb::init<Servo&>(), "servo"_a, nb::keep_alive<1, 2>());
    nb::class_<Replay, Device>(m, "Replay", "Commands of a record, each obeyed from its tick on.")
        .def(
            "__init__",
            [](Replay* self, In<int64_t, 1> ticks, In<uint8_t, 1> tools, In<uint8_t, 1> kinds, In<double, 2> points,
               In<double, 2> displacements, In<int64_t, 1> switches, In<uint8_t, 1> lacking) {
                if (lacking.shape(0) != switches.shape(0)) throw std::invalid_argument("lacking: one for each switch");
                std::vector<Switch> all;
                for (size_t i = 0; i < switches.shape(0); i++) all.push_back({switches(i), lacking(i)});
                new (self) Replay({ticks.data(), ticks.data() + ticks.shape(0)}, tool_numbers(tools, ticks.shape(0)),
                                  commands(kinds, points, displacements), std::move(all));
            },
            "ticks"_a, "tools"_a, "kinds"_a, "points"_a, "displacements"_a, "switches"_a, "lacking"_a);
}

void bind_frame(nb::module_& m) {
    nb::class_<Frame>(m, "Frame", "What a display needs of one tick, tool by tool; mm, N.")
        .def_ro("tick", &Frame::tick)
        .def_ro("late", &Frame::late)
        .def_ro("faults", &Frame::faults)
        .def_ro("serial", &Frame::serial)
        .def_ro("seconds", &Frame::seconds)
        .def_ro("busy", &Frame::busy)
        .def_ro("work", &Frame::work)
        .def_prop_ro("grip", &grips)
        .def_prop_ro("point", [](const Frame& f) { return vectors(f.point); })
        .def_prop_ro("displacement", [](const Frame& f) { return vectors(f.displacement); })
        .def_prop_ro("force", [](const Frame& f) { return vectors(f.force); })
        .def_prop_ro("answer", [](const Frame& f) { return vectors(f.answer); })
        .def_prop_ro("pushed", [](const Frame& f) { return vectors(f.pushed); })
        .def_prop_ro("tip", [](const Frame& f) { return vectors(f.tip); })
        .def_prop_ro("axis", [](const Frame& f) { return vectors(f.axis); })
        .def_prop_ro("inside", [](const Frame& f) { return std::vector<double>(f.inside, f.inside + most_tools); })
        .def_prop_ro("shown", [](const Frame& f) { return rows(f.shown); }, nb::rv_policy::automatic);
}

#define PALPATE_MANNER(name, field)                                                                                    \
    .def_prop_rw(                                                                                                      \
        name, [](const Settings& s) { return s.manner.field; },                                                        \
        [](Settings& s, double value) { s.manner.field = value; })

} // namespace

void bind_simulation(nb::module_& m) {
    bind_devices(m);
    bind_frame(m);
    nb::class_<Settings>(m, "Settings", "What a tick does besides the model; mm, N, a tick.")
        .def(nb::init<>())
        .def_rw("sweeps", &Settings::sweeps)
        .def_rw("limit", &Settings::limit)
        .def_rw("ramp", &Settings::ramp) PALPATE_MANNER("radius", radius) PALPATE_MANNER("friction", friction)
            PALPATE_MANNER("approach", pace.approach) PALPATE_MANNER("reach", pace.reach)
                PALPATE_MANNER("puncture", needle.puncture) PALPATE_MANNER("cutting", needle.cutting)
                    PALPATE_MANNER("shaft_friction", needle.friction);
    nb::class_<Driven>(m, "Loop", "A model, a surface and a tool: by the clock (start, stop) or in lockstep (step).")
        .def(nb::init<const Model&, const Surface&, In<int32_t, 1>, const Settings&>(), "model"_a, "surface"_a,
             "shown"_a, "settings"_a, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
        .def(
            "start", [](Driven& d, Device& device) { d.loop.start(device); }, "device"_a, nb::keep_alive<1, 2>())
        .def(
            "stop", [](Driven& d) { d.loop.stop(); }, nb::call_guard<nb::gil_scoped_release>())
        .def_prop_ro("running", [](const Driven& d) { return d.loop.running(); })
        .def("step", &step, "device"_a, "ticks"_a, "(ticks, tools, 3) N")
        .def(
            "look_ahead", [](Driven& d) { d.loop.look_ahead(); },
            "What the loop does between ticks by the clock: nothing that is felt. Not while it runs.")
        .def(
            "change",
            [](Driven& d, const Model& model, int sweeps) {
                if (model.nodes() != d.loop.now().nodes()) throw std::invalid_argument("model: of another mesh");
                return d.loop.change(model, sweeps);
            },
            "model"_a, "sweeps"_a, nb::keep_alive<1, 2>(), nb::call_guard<nb::gil_scoped_release>(),
            "Another model of the same tissue from the next tick on; False while one is on its way.")
        .def(
            "tidy", [](Driven& d) { d.loop.tidy(); }, nb::call_guard<nb::gil_scoped_release>())
        .def("changes", &drain_changes, nb::sig("def changes(self) -> list[tuple[int, Model]]"),
             "Ticks that first ran another model, and it, since the last call.")
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
        .def(
            "tallies",
            [](const Driven& d) {
                auto column = [](const Tally& tally) { return OneColumn<int64_t>::from(tally.counts()); };
                return nb::make_tuple(column(d.loop.worked), column(d.loop.computed), column(d.loop.woken));
            },
            nb::sig("def tallies(self) -> tuple[typing.Any, ...]"),
            "By the clock, counts in steps of 10 us, the last of all that was longer: a tick's time, its processor "
            "time, and how late it began.")
        .def("drain", &drain, nb::sig("def drain(self) -> tuple[typing.Any, ...]"),
             "Commands obeyed, digests and switches of tables since the last call.")
        .def("dropped", [](const Driven& d) {
            return d.loop.obeyed.dropped() + d.loop.digests.dropped() + d.loop.switches.dropped() +
                   d.loop.changes.dropped();
        });
    m.attr("TOOLS") = int(most_tools);
    m.attr("RATE") = int(Loop::rate);
    m.attr("DIGEST_TICKS") = int(Loop::digest_ticks);
}
