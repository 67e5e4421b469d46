#include "bindings/arrays.h"
#include "haptics/driver.h"
#include "haptics/room_device.h"
#include "haptics/servo_device.h"
#include "haptics/virtual_wall.h"
#include "net/json_reader.h"
#include <algorithm>
#include <cmath>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

using namespace nb::literals;
using namespace palpate;

namespace {

using Matrix = std::array<double, 9>;

// A property that is an array in C++ and a tuple-like in Python.
template <auto member, size_t n> void array_property(nb::class_<ServoSettings>& c, const char* name) {
    using Values = std::array<double, n>;
    c.def_prop_rw(
        name,
        [](const ServoSettings& s) {
            Values v;
            std::copy_n(s.*member, n, v.begin());
            return v;
        },
        [](ServoSettings& s, const Values& v) { std::copy_n(v.begin(), n, s.*member); });
}

void bind_settings(nb::module_& m) {
    nb::class_<ServoSettings> c(m, "ServoSettings", "A device's limits and frame; mm, N, s.");
    c.def(nb::init<>()).def("__copy__", [](const ServoSettings& s) { return s; });
    c.def_rw("period", &ServoSettings::period)
        .def_rw("force", &ServoSettings::force)
        .def_rw("stiffness", &ServoSettings::stiffness)
        .def_rw("damping", &ServoSettings::damping)
        .def_rw("max_damping", &ServoSettings::max_damping)
        .def_rw("energy_limit", &ServoSettings::energy_limit)
        .def_rw("scale", &ServoSettings::scale)
        .def_rw("max_speed", &ServoSettings::max_speed)
        .def_rw("ramp", &ServoSettings::ramp)
        .def_rw("blend", &ServoSettings::blend)
        .def_rw("withdrawal", &ServoSettings::withdrawal)
        .def_rw("max_age", &ServoSettings::max_age)
        .def_rw("recovery", &ServoSettings::recovery)
        .def_rw("debounce", &ServoSettings::debounce);
    array_property<&ServoSettings::lowest, 3>(c, "lowest");
    array_property<&ServoSettings::highest, 3>(c, "highest");
    array_property<&ServoSettings::rotation, 9>(c, "rotation");
    array_property<&ServoSettings::offset, 3>(c, "offset");
}

void bind_status(nb::module_& m) {
    nb::class_<ServoStatus>(m, "ServoStatus", "State of a servo; mm, N, s, mJ.")
        .def_ro("ticks", &ServoStatus::ticks)
        .def_ro("late", &ServoStatus::late)
        .def_ro("answers", &ServoStatus::answers)
        .def_ro("faults", &ServoStatus::faults)
        .def_ro("period", &ServoStatus::period)
        .def_ro("worst", &ServoStatus::worst)
        .def_ro("energy", &ServoStatus::energy)
        .def_ro("damping", &ServoStatus::damping)
        .def_ro("gain", &ServoStatus::gain)
        .def_ro("zeroed", &ServoStatus::zeroed)
        .def_prop_ro("force", [](const ServoStatus& s) { return vector(s.force); })
        .def_prop_ro("position", [](const ServoStatus& s) { return vector(s.position); })
        .def_prop_ro("fault", [](const ServoStatus& s) { return fault_name(s.fault); })
        .def_prop_ro("last", [](const ServoStatus& s) { return fault_name(s.last); })
        .def_prop_ro("text", [](const ServoStatus& s) { return fault_text(s.fault); });
    nb::class_<DevicePose>(m, "DevicePose", "A device's reading; mm, world.")
        .def_ro("serial", &DevicePose::serial)
        .def_ro("buttons", &DevicePose::buttons)
        .def_ro("present", &DevicePose::present)
        .def_prop_ro("position", [](const DevicePose& p) { return vector(p.position); })
        .def_prop_ro("hand", [](const DevicePose& p) { return vector(p.hand); });
}

void answer(Servo& servo, bool touching, const Vector3& at, const Vector3& force, const Matrix& stiffness,
            const Vector3& normal, int64_t serial, bool withdrawn) {
    LocalContactModel& local = servo.answers.write_slot();
    local.serial = serial;
    local.touching = touching;
    local.withdrawn = withdrawn;
    std::copy(at.begin(), at.end(), local.at);
    std::copy(force.begin(), force.end(), local.force);
    std::copy(stiffness.begin(), stiffness.end(), local.stiffness);
    std::copy(normal.begin(), normal.end(), local.normal);
    servo.answers.publish();
}

void tell(RoomDevice& device, const std::array<int64_t, most_tools>& hands,
          const std::array<std::array<double, 9>, most_tools>& places, int64_t begun, int patience, bool withheld,
          bool stopped) {
    RoomNews news;
    for (int t = 0; t < most_tools; t++) {
        RoomTool& tool = news.tool[t];
        tool.hand = hands[t];
        std::copy_n(places[t].begin(), 3, tool.point);
        std::copy_n(places[t].begin() + 3, 3, tool.displacement);
        std::copy_n(places[t].begin() + 6, 3, tool.tissue);
    }
    news.begun = begun, news.patience = patience, news.withheld = withheld, news.stopped = stopped;
    device.tell(news);
}

void bind_servo(nb::module_& m) {
    nb::class_<Servo>(m, "Servo", "A position in, a force out, at a device's own rate.")
        .def(nb::init<const ServoSettings&>(), "settings"_a)
        .def(
            "tick",
            [](Servo& servo, const Vector3& position, uint8_t buttons, int64_t now) {
                expect(within<int64_t>(now, 0, int64_t(1) << 62), "now_ns: 0 to 2^62");
                Vector3 force;
                servo.tick(position.data(), buttons, now, force.data());
                return force;
            },
            "position"_a, "buttons"_a, "now_ns"_a, "Only while no driver runs.")
        .def(
            "lose", [](Servo& servo) { servo.lose(); }, "Only while no driver runs.")
        .def("restart", &Servo::restart, "Only while no driver runs.")
        .def("answer", &answer, "touching"_a, "at"_a, "force"_a, "stiffness"_a, "normal"_a, "serial"_a,
             "withdrawn"_a = false, "In the solver's place: from one thread only.")
        .def(
            "pose", [](Servo& servo) { return servo.poses.latest(); },
            "The newest one, in the solver's place: from one thread only.")
        .def("status", [](Servo& servo) { return servo.status.latest(); }, "The newest one; from one thread only.");
    nb::class_<ServoDevice, Device>(
        m, "ServoDevice",
        "A force-feedback device as the loop sees it: a tool in space; its button holds, the second cuts.")
        .def(nb::init<Servo&>(), "servo"_a, nb::keep_alive<1, 2>())
        .def_prop_rw(
            "edge", [](const ServoDevice& device) { return device.edge.load(); },
            [](ServoDevice& device, double mm) { device.edge = mm; }, "mm that its blade is deep; 0: it has none.");
    nb::class_<RoomDevice, Device>(
        m, "RoomDevice", "A device at one site of a room: its own tool, and those of others where the room says.")
        .def(nb::init<Servo&>(), "servo"_a, nb::keep_alive<1, 2>())
        .def_prop_rw(
            "edge", [](RoomDevice& device) { return device.edge().load(); },
            [](RoomDevice& device, double mm) { device.edge() = mm; }, "mm that its blade is deep; 0: it has none.")
        .def("tell", &tell, "hands"_a, "places"_a, "begun"_a, "patience"_a, "withheld"_a, "stopped"_a,
             "What the room says. hands: whose each tool is, 0 nobody's. places: point, displacement and that of the "
             "tissue there, mm. patience: ticks until the next news.");
    nb::class_<VirtualWall>(m, "VirtualWall", "A stand-in for the solver: a flat wall. For tests of devices.")
        .def(
            "__init__",
            [](VirtualWall* self, Servo& servo, double stiffness, const Vector3& point, const Vector3& normal,
               double reported, int delay) {
                expect(within(delay, 0, 1'000'000), "delay: 0 to 1000000");
                new (self) VirtualWall(servo, stiffness, point.data(), normal.data(), reported, delay);
            },
            "servo"_a, "stiffness"_a, "point"_a, "normal"_a, "reported"_a = 1.0, "delay"_a = 0, nb::keep_alive<1, 2>())
        .def("answer", &VirtualWall::answer, "To the newest pose; not while its thread runs.")
        .def(
            "start",
            [](VirtualWall& wall, int rate) {
                expect(within(rate, 1, 1'000'000), "rate: 1 to 1000000");
                wall.start(rate);
            },
            "rate"_a)
        .def("stop", &VirtualWall::stop, nb::call_guard<nb::gil_scoped_release>())
        .def_prop_ro("answered", [](const VirtualWall& s) { return s.answered.load(); })
        .def_prop_ro("last_ns", [](const VirtualWall& s) { return s.last_ns.load(); })
        .def_prop_rw(
            "mode", [](const VirtualWall& s) { return s.mode.load(); }, [](VirtualWall& s, int mode) { s.mode = mode; },
            "0: it answers, 1: it stalls, 2: its answers are not finite.");
}

} // namespace

void bind_haptics(nb::module_& m) {
    bind_settings(m);
    bind_status(m);
    bind_servo(m);
    const std::string full = nb::cast<std::string>(m.attr("__name__")) + ".DriverError";
    static PyObject* error = PyErr_NewException(full.c_str(), PyExc_RuntimeError, nullptr);
    m.attr("DriverError") = nb::borrow(error);
    nb::register_exception_translator([](const std::exception_ptr& thrown, void*) {
        try {
            std::rethrow_exception(thrown);
        } catch (const DriverError& e) {
            PyErr_SetObject(error, nb::make_tuple(e.fault, e.what()).ptr());
        }
    });
    m.attr("FAULTS") = fault_count;
    const auto fault_of = [](int fault) {
        expect(within(fault, 0, fault_count - 1), "fault: no such number");
        return Fault(fault);
    };
    m.def("fault_name", [fault_of](int fault) { return fault_name(fault_of(fault)); }, "fault"_a);
    m.def("fault_text", [fault_of](int fault) { return fault_text(fault_of(fault)); }, "fault"_a);
    nb::class_<FoundDevice>(m, "FoundDevice", "A device that answered.")
        .def_ro("driver", &FoundDevice::driver)
        .def_ro("model", &FoundDevice::model)
        .def_ro("serial", &FoundDevice::serial)
        .def_ro("version", &FoundDevice::version);
    nb::class_<Driver>(m, "Driver", "A maker's driver.")
        .def_prop_ro("name", &Driver::name)
        .def("open", &Driver::open, nb::call_guard<nb::gil_scoped_release>())
        .def("limits", &Driver::limits, "Of the open device.")
        .def("start", &Driver::start, "servo"_a, nb::keep_alive<1, 2>(), nb::call_guard<nb::gil_scoped_release>())
        .def("stop", &Driver::stop, nb::call_guard<nb::gil_scoped_release>());
    m.def(
        "json_at",
        [](const std::string& text, const std::vector<std::string>& path) {
            JsonReader at(text);
            for (const auto& step : path)
                at = step.empty() || step[0] != '#' ? at[std::string_view(step)] : at[std::stoi(step.substr(1))];
            return nb::make_tuple(at.exists(), at.number(NAN), std::string(at.string()));
        },
        "text"_a, "path"_a, nb::sig("def json_at(text: str, path: typing.Sequence[str]) -> tuple[bool, float, str]"),
        "What the Haply driver reads at `path`, a member's name or #element each: is it there, as number, as string.");
    m.def("open_haptics", &open_haptics, "library"_a, "device"_a);
    m.def("force_dimension", &force_dimension, "library"_a, "rate"_a);
    m.def("haply", &haply, "host"_a, "port"_a, "rate"_a);
}
