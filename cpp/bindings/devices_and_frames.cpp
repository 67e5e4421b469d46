// The two ends of the loop: commands that come from a device, and frames for a display.
#include "bindings/tissue.h"
#include "simulation/pointer.h"
#include "simulation/realtime_loop.h"
#include "simulation/replay.h"
#include <nanobind/stl/array.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

namespace {

CommandKind kind(int number) {
    expect(within(number, 0, int(CommandKind::carry)), "kind: 0 to 5");
    return CommandKind(number);
}

std::vector<Command> commands(In<uint8_t, 1> kinds, In<double, 2> points, In<double, 2> displacements) {
    std::vector<Command> all(kinds.shape(0));
    for (const auto* each : {&points, &displacements})
        expect_vectors(*each, all.size(), "kinds (n,), points (n, 3), displacements (n, 3)");
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
    return listed(tools);
}

std::vector<int> contacts(const Frame& f) { return {f.contact, f.contact + most_tools}; }
std::vector<Vector3> vectors(const double* v) { // of each tool
    std::vector<Vector3> out;
    for (int t = 0; t < most_tools; t++) out.push_back(vector(v + 3 * t));
    return out;
}

} // namespace

void bind_devices(nb::module_& m) {
    m.attr("MAX_TOOLS") = int(most_tools);
    nb::enum_<CommandKind>(m, "CommandKind", nb::is_arithmetic(), "What a tool is asked to do.")
        .value("away", CommandKind::away, "Let go.")
        .value("hold", CommandKind::hold, "Hold the tissue at a point of its surface and displace it.")
        .value("needle", CommandKind::needle, "Enter at a point of the surface.")
        .value("free", CommandKind::free, "Go to a point in space; contact follows from that.")
        .value("blade", CommandKind::blade, "Cut along the surface towards a point there.")
        .value("carry", CommandKind::carry, "Hold a loose piece and move it.");
    nb::enum_<ContactState>(m, "ContactState", nb::is_arithmetic(), "What a tool's proxy is doing.")
        .value("idle", ContactState::idle, "No command.")
        .value("closed", ContactState::closed, "In contact: the tissue follows it.")
        .value("refused", ContactState::refused, "Cannot hold here; until it is let go.")
        .value("open", ContactState::open, "Follows the tissue without a force: in space, or about to hold.")
        .value("cutting", ContactState::cutting, "A blade in the tissue.")
        .value("carrying", ContactState::carrying, "Holds a loose piece.");
    nb::enum_<PieceState>(m, "PieceState", nb::is_arithmetic(), "Where a piece is that a cut has freed.")
        .value("lying", PieceState::lying, "Where it came free.")
        .value("carried", PieceState::carried, "In a tool.")
        .value("falling", PieceState::falling, "Freely.")
        .value("gone", PieceState::gone, "Out of the scene.");
    nb::class_<Device>(m, "Device", "The other end of the loop.");
    nb::class_<Pointer, Device>(m, "Pointer", "Commands from another thread; the newest wins.")
        .def(nb::init<>())
        .def(
            "send",
            [](Pointer& pointer, int tool, int number, Vector3 point, Vector3 displacement, int64_t serial) {
                if (tool < 0 || tool >= most_tools) throw std::invalid_argument("tool: 0 to 3");
                Command command{kind(number), {point[0], point[1], point[2]}, {}};
                for (int k = 0; k < 3; k++) command.displacement[k] = displacement[k];
                pointer.send(tool, command, serial);
            },
            "tool"_a, "kind"_a, "point"_a, "displacement"_a, "serial"_a = 0, "From one thread only; mm.");
    nb::class_<Replay, Device>(m, "Replay", "Commands of a record, each obeyed from its tick on.")
        .def(
            "__init__",
            [](Replay* self, In<int64_t, 1> ticks, In<uint8_t, 1> tools, In<uint8_t, 1> kinds, In<double, 2> points,
               In<double, 2> displacements, In<int64_t, 1> switches, In<uint8_t, 1> missing_tables, bool recorded) {
                expect(missing_tables.size() == switches.size(), "lacking: one for each switch");
                std::vector<TableEvent> all;
                for (size_t i = 0; i < switches.shape(0); i++) all.push_back({switches(i), missing_tables(i)});
                new (self) Replay(listed(ticks), tool_numbers(tools, ticks.size()),
                                  commands(kinds, points, displacements), std::move(all), recorded);
            },
            "ticks"_a, "tools"_a, "kinds"_a, "points"_a, "displacements"_a, "switches"_a, "lacking"_a,
            "recorded"_a = false);
}

void bind_frame(nb::module_& m) {
    nb::class_<Frame>(m, "Frame", "What a display needs of one tick, tool by tool; mm, N.")
        .def_ro("tick", &Frame::tick)
        .def_ro("body", &Frame::body)
        .def_ro("late", &Frame::late)
        .def_ro("faults", &Frame::faults)
        .def_ro("serial", &Frame::serial)
        .def_ro("seconds", &Frame::seconds)
        .def_ro("busy", &Frame::busy)
        .def_ro("work", &Frame::work)
        .def_ro("solution_age", &Frame::solution_age)
        .def_ro("solution_error", &Frame::solution_error)
        .def_prop_ro("contact", &contacts)
        .def_prop_ro("point", [](const Frame& f) { return vectors(f.point); })
        .def_prop_ro("displacement", [](const Frame& f) { return vectors(f.displacement); })
        .def_prop_ro("force", [](const Frame& f) { return vectors(f.force); })
        .def_prop_ro("model_force", [](const Frame& f) { return vectors(f.model_force); })
        .def_prop_ro("device_force", [](const Frame& f) { return vectors(f.device_force); })
        .def_prop_ro(
            "device_stiffness",
            [](const Frame& f) { return std::vector<double>(f.device_stiffness, f.device_stiffness + most_tools); })
        .def_prop_ro("tip", [](const Frame& f) { return vectors(f.tip); })
        .def_prop_ro("axis", [](const Frame& f) { return vectors(f.axis); })
        .def_prop_ro(
            "piece_state",
            [](const Frame& f) { return std::vector<PieceState>(f.piece_state, f.piece_state + f.piece_count); })
        .def_prop_ro(
            "piece_offset",
            [](const Frame& f) {
                return rows(std::vector<double>(f.piece_offset, f.piece_offset + 3 * f.piece_count));
            },
            nb::rv_policy::automatic)
        .def_prop_ro("insertion",
                     [](const Frame& f) { return std::vector<double>(f.insertion, f.insertion + most_tools); })
        .def_prop_ro(
            "shown",
            [](const Frame& f) {
                return rows(std::vector<float>(f.shown.begin(), f.shown.begin() + 3 * f.shown_count));
            },
            nb::rv_policy::automatic);
}
