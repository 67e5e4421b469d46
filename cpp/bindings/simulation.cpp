#include "bindings/tissue.h"
#include "realtime/timer_jitter.h"
#include "simulation/realtime_loop.h"
#include <algorithm>
#include <cmath>
#include <nanobind/stl/array.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

void bind_devices(nb::module_& m); // devices_and_frames.cpp
void bind_frame(nb::module_& m);

namespace {

struct Driven { // the loop, and what it runs on after a cut
    nb::object body[3],
        before[3]; // a model, its surface and that of loose pieces; those may go that were replaced before
    RealtimeLoop loop;
    const ToolSettings tools;
    int nodes;      // of the body that was asked for last
    int pieces = 0; // beside it
    int widest = 0; // nodes of a patch
    Driven(const TissueModel& model, const ContactSurface& surface, In<int32_t, 1> shown,
           const SimulationSettings& settings)
        : loop(model, checked(model, surface, shown, settings), settings, listed(shown)), tools(settings.tools),
          nodes(model.nodes()) {
        require_room(surface);
    }
    void require_room(const ContactSurface& surface) {
        if (int at = crowded(surface); at >= 0)
            throw std::invalid_argument("a contact of radius " + std::to_string(tools.radius) +
                                        " mm covers more than " + std::to_string(ContactPatch::capacity) +
                                        " nodes, for example about node " + std::to_string(at));
    }
    static const ContactSurface& checked(const TissueModel& model, const ContactSurface& surface,
                                         const In<int32_t, 1>& shown, const SimulationSettings& settings) {
        check_surface(model, surface);
        expect(surface.triangles() > 0, "surface: it is empty");
        expect_numbers(shown, size_t(model.nodes()), "shown: a node that is not there");
        check_count(settings.sweeps);
        check_radius(settings.tools.radius);
        return surface;
    }
    int crowded(const ContactSurface& surface) { // a node whose patch would be too big, or -1
        widest = 0;
        auto scratch = surface.scratch();
        ContactPatch patch;
        std::vector<bool> seen(surface.vertices());
        for (int t = 0; t < surface.triangles(); t++)
            for (int c = 0; c < 3; c++) {
                int v = surface.corner[3 * t + c];
                if (seen[v]) continue;
                seen[v] = true;
                SurfacePoint at;
                at.triangle = t;
                at.weight[c] = 1;
                std::copy_n(&surface.position[3 * v], 3, at.point);
                const auto status = tools.nodal_weights ? surface.nodal_patch(at, tools.radius, scratch, patch)
                                                        : surface.patch(at, tools.radius, scratch, patch);
                if (status == ContactSurface::PatchStatus::too_many_nodes) return surface.node[v];
                if (status == ContactSurface::PatchStatus::good) widest = std::max(widest, patch.count);
            }
        return -1;
    }
};

LoosePieces loose_pieces(const nb::object& surface, const In<int32_t, 1>& piece_of, const In<double, 1>& weight,
                         const In<uint8_t, 1>& bedded, const In<int32_t, 1>& before, int pieces_before) {
    const size_t count = weight.shape(0);
    expect(count <= most_pieces && bedded.shape(0) == count && before.shape(0) == count, "weight: too many pieces");
    expect(surface.is_none() == (count == 0), "pieces: a surface of those that there are");
    LoosePieces loose;
    if (!count) return loose;
    loose.surface = &nb::cast<const ContactSurface&>(surface);
    expect(loose.surface->triangles() > 0 && piece_of.shape(0) == size_t(loose.surface->triangles()),
           "piece_of: one for each triangle");
    expect_numbers(piece_of, count, "piece_of: a piece that is not there");
    for (size_t i = 0; i < count; i++) {
        expect(within(before(i), -1, pieces_before - 1), "number_before: a piece that was not there");
        LoosePiece piece;
        piece.weight = weight(i), piece.bedded = bedded(i) != 0;
        loose.piece.push_back(piece);
    }
    loose.before = listed(before), loose.piece_of = listed(piece_of);
    return loose;
}

nb::tuple drain(Driven& driven) {
    std::vector<CommandEvent> command_events;
    std::vector<StateDigest> digests;
    std::vector<TableEvent> table_events;
    driven.loop.digests.drain(digests); // first: then all events before the last digest are in what is drained
    driven.loop.table_events.drain(table_events);
    driven.loop.command_events.drain(command_events);
    std::vector<int64_t> ticks, digest_ticks;
    std::vector<uint64_t> values;
    std::vector<uint8_t> tools, kinds, missing_tables;
    std::vector<int64_t> switch_ticks;
    std::vector<double> points, displacements;
    for (const auto& [tick, tool, command] : command_events) {
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
    for (const auto& change : table_events) {
        switch_ticks.push_back(change.tick);
        missing_tables.push_back(uint8_t(change.missing_tables));
    }
    return nb::make_tuple(copied(ticks), copied(tools), copied(kinds), rows(points), rows(displacements),
                          copied(digest_ticks), copied(values), copied(switch_ticks), copied(missing_tables));
}

std::vector<int64_t> drain_changes(Driven& driven) {
    std::vector<int64_t> changes;
    driven.loop.changes.drain(changes);
    return changes;
}

Owned<double, 3> step(Driven& driven, Device& device, int64_t ticks) {
    expect(within<int64_t>(ticks, 0, 10'000'000), "ticks: 0 to 10000000");
    auto forces = zeros<double>(ticks, most_tools, 3);
    nb::gil_scoped_release release;
    driven.loop.step(device, ticks, forces.data());
    return forces;
}

#define PALPATE_TOOL_SETTING(name, field)                                                                              \
    .def_prop_rw(                                                                                                      \
        name, [](const SimulationSettings& s) { return s.tools.field; },                                               \
        [](SimulationSettings& s, double value) { s.tools.field = value; })

} // namespace

void bind_simulation(nb::module_& m) {
    bind_devices(m);
    bind_frame(m);
    nb::class_<CutResistance>(m, "CutResistance", "The toughness along a blade's edge in a body before all cuts.")
        .def(
            "__init__",
            [](CutResistance* self, In<double, 2> nodes, In<int32_t, 2> tets, In<int32_t, 1> region,
               std::map<int32_t, double> toughness) {
                expect(nodes.shape(1) == 3 && tets.shape(1) == 4 && tets.shape(0) == region.shape(0),
                       "nodes, tets, region: expected (nodes, 3), (tets, 4), (tets)");
                expect_numbers(tets, nodes.shape(0), "tets: names a node that is not there");
                std::vector<int32_t> label;
                std::vector<double> value;
                for (const auto& [one, tough] : toughness) {
                    expect(std::isfinite(tough) && tough >= 0, "toughness: expected finite numbers of 0 or more");
                    label.push_back(one), value.push_back(tough);
                }
                new (self) CutResistance(nodes.data(), tets.data(), region.data(), int(tets.shape(0)), label.data(),
                                         value.data(), int(label.size()));
            },
            "nodes"_a, "tets"_a, "region"_a, "toughness"_a, "mm; labels; J/m^2 by label, 0 for others.")
        .def_prop_ro("toughness",
                     [](const CutResistance& r) {
                         std::map<int32_t, double> out;
                         for (size_t i = 0; i < r.label.size(); i++) out[r.label[i]] = r.toughness[i];
                         return out;
                     })
        .def(
            "along",
            [](const CutResistance& r, Vector3 point, Vector3 way) {
                const CutResistance::Edge met = r.along(point.data(), way.data());
                return std::pair(met.inside, met.toughness);
            },
            "point"_a, "way"_a, "mm of an edge that lie in the body, and J/m^2 mm.");
    nb::class_<SimulationSettings>(m, "SimulationSettings", "What a tick does besides the model; mm, N, a tick.")
        .def(nb::init<>())
        .def_rw("sweeps", &SimulationSettings::sweeps)
        .def_rw("limit", &SimulationSettings::limit)
        .def_rw("ramp", &SimulationSettings::ramp)
        .def_prop_rw(
            "nodal_weights", [](const SimulationSettings& s) { return s.tools.nodal_weights; },
            [](SimulationSettings& s, bool value) { s.tools.nodal_weights = value; })
            PALPATE_TOOL_SETTING("radius", radius) PALPATE_TOOL_SETTING("friction", friction)
                PALPATE_TOOL_SETTING("approach", motion.approach) PALPATE_TOOL_SETTING("reach", motion.reach)
                    PALPATE_TOOL_SETTING("puncture", needle.puncture) PALPATE_TOOL_SETTING("cutting", needle.cutting)
                        PALPATE_TOOL_SETTING("shaft_friction", needle.friction)
                            PALPATE_TOOL_SETTING("blade_friction", blade.friction)
                                PALPATE_TOOL_SETTING("give", blade.give)
        .def_prop_rw(
            "resistance",
            [](const SimulationSettings& s) { return std::const_pointer_cast<CutResistance>(s.tools.blade.tissue); },
            [](SimulationSettings& s, std::shared_ptr<CutResistance> of) { s.tools.blade.tissue = std::move(of); },
            nb::arg().none(), "What new surface takes: a CutResistance, or None.");
    nb::class_<Driven>(m, "RealtimeLoop",
                       "A model, a surface and a tool: by the clock (start, stop) or in lockstep (step).")
        .def(nb::init<const TissueModel&, const ContactSurface&, In<int32_t, 1>, const SimulationSettings&>(),
             "model"_a, "surface"_a, "shown"_a, "settings"_a, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
        .def(
            "start", [](Driven& d, Device& device) { d.loop.start(device); }, "device"_a, nb::keep_alive<1, 2>())
        .def(
            "stop", [](Driven& d) { d.loop.stop(); }, nb::call_guard<nb::gil_scoped_release>())
        .def_prop_ro("running", [](const Driven& d) { return d.loop.running(); })
        .def("step", &step, "device"_a, "ticks"_a, "(ticks, tools, 3) N")
        .def(
            "look_ahead",
            [](Driven& d) {
                expect(!d.loop.running(), "look_ahead: the loop runs");
                d.loop.look_ahead();
            },
            "What the loop does between ticks by the clock: nothing that is feedback. Not while it runs.")
        .def(
            "change",
            [](Driven& d, const TissueModel& model, int sweeps) {
                expect(model.nodes() == d.nodes, "model: of another mesh");
                check_count(sweeps);
                return d.loop.change(model, sweeps);
            },
            "model"_a, "sweeps"_a, nb::keep_alive<1, 2>(), nb::call_guard<nb::gil_scoped_release>(),
            "Another model of the same tissue from the next tick on; False while one is on its way.")
        .def(
            "change_body",
            [](Driven& d, nb::object model, nb::object surface, In<int32_t, 1> shown, int sweeps, nb::object pieces,
               In<int32_t, 1> piece_of, In<double, 1> weight, In<uint8_t, 1> bedded, In<int32_t, 1> number_before,
               Vector3 down, double depth) {
                const auto& to = nb::cast<const TissueModel&>(model);
                const auto& on = nb::cast<const ContactSurface&>(surface);
                Driven::checked(to, on, shown, SimulationSettings());
                check_count(sweeps);
                expect(shown.shape(0) <= d.loop.shown_room, "shown: too many nodes");
                // A patch at a cut has the nodes of both lips, and of the layer below them.
                if (4 * d.widest > ContactPatch::capacity) d.require_room(on);
                LoosePieces beside = loose_pieces(pieces, piece_of, weight, bedded, number_before, d.pieces);
                std::copy_n(down.data(), 3, beside.down);
                beside.depth = depth;
                bool done;
                {
                    nb::gil_scoped_release release;
                    done = d.loop.change_body(to, on, sweeps, listed(shown), std::move(beside));
                }
                if (!done) return false;
                for (int k = 0; k < 3; k++) d.before[k] = std::move(d.body[k]);
                d.body[0] = std::move(model), d.body[1] = std::move(surface), d.body[2] = std::move(pieces);
                d.pieces = int(weight.shape(0));
                d.nodes = to.nodes();
                return true;
            },
            "model"_a, "surface"_a, "shown"_a, "sweeps"_a, "pieces"_a.none(), "piece_of"_a, "weight"_a, "bedded"_a,
            "number_before"_a, "down"_a, "depth"_a,
            nb::sig("def change_body(self, model: palpate._core.tissue.TissueModel, surface: "
                    "palpate._core.tissue.ContactSurface, shown: typing.Any, sweeps: int, pieces: "
                    "palpate._core.tissue.ContactSurface | None, piece_of: typing.Any, weight: typing.Any, bedded: "
                    "typing.Any, number_before: typing.Any, down: typing.Any, depth: float) -> bool"),
            "A body that was cut, from the next tick on; False while a change is on its way. pieces: surface of those "
            "beside it, and piece_of: to which of them each of its triangles belongs; weight: N.")
        .def(
            "change_pending", [](Driven& d) { return d.loop.change_pending(); },
            nb::call_guard<nb::gil_scoped_release>(), "Whether another change would be refused.")
        .def(
            "free_retired", [](Driven& d) { d.loop.free_retired(); }, nb::call_guard<nb::gil_scoped_release>())
        .def("changes", &drain_changes, "Ticks that first ran another model or body, since the last call.")
        .def(
            "wait_frame",
            [](Driven& d, int64_t serial, int64_t tick, double seconds) {
                expect(within(seconds, 0.0, 60.0), "seconds: 0 to 60");
                return d.loop.wait_frame(serial, tick, seconds);
            },
            "serial"_a, "tick"_a, "seconds"_a, nb::call_guard<nb::gil_scoped_release>(),
            "Waits for an unread frame that obeys another command than `serial`, or is of `tick` or later.")
        .def(
            "frame", [](Driven& d) { return d.loop.frames.latest(); }, "The newest frame; from one thread only.")
        .def(
            "displacement",
            [](Driven& d) {
                expect(!d.loop.running(), "displacement: the loop runs");
                std::vector<double> u(3 * size_t(d.loop.current().nodes()));
                d.loop.current().displacement(u.data());
                return rows(u);
            },
            "(N, 3) mm; not while it runs")
        .def(
            "tallies",
            [](const Driven& d) {
                auto column = [](const LatencyHistogram& tally) { return copied(tally.counts()); };
                return nb::make_tuple(column(d.loop.tick_time), column(d.loop.processor_time),
                                      column(d.loop.wake_latency));
            },
            nb::sig("def tallies(self) -> tuple[typing.Any, ...]"),
            "By the clock, counts in steps of 10 us, the last of all that was longer: a tick's time, its processor "
            "time, and how late it began.")
        .def("drain", &drain, nb::sig("def drain(self) -> tuple[typing.Any, ...]"),
             "Commands obeyed, digests and switches of tables since the last call.")
        .def("dropped", [](const Driven& d) {
            return d.loop.command_events.dropped() + d.loop.digests.dropped() + d.loop.table_events.dropped() +
                   d.loop.changes.dropped();
        });
    m.def(
        "sweep_seconds",
        [](const TissueModel& model, const ContactSurface& surface, double radius) {
            check_surface(model, surface);
            check_radius(radius);
            return sweep_seconds(model, surface, radius);
        },
        "model"_a, "surface"_a, "radius"_a, "Seconds that one sweep of the model takes on this machine, at best.");
    m.def("realtime_priority", &realtime_priority_allowed,
          "Whether the system lets the loop's thread run before ordinary ones.");
    m.attr("RATE") = int(RealtimeLoop::rate);
}
