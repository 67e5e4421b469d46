// PHANToM and Touch through the maker's libHD. The declarations are ours, written from what its reference manual says
// of each function; the library is the user's.
#include "haptics/shared_library.h"
#include "realtime/periodic_timer.h"
#include <algorithm>
#include <atomic>
#include <cmath>

namespace palpate {
namespace {

struct HdError { // HDErrorInfo
    unsigned code;
    int internal;
    unsigned device;
};
using Callback = unsigned (*)(void*);

constexpr unsigned no_handle = 0xFFFFFFFF, finished = 0, go_on = 1; // HD_CALLBACK_DONE, HD_CALLBACK_CONTINUE
constexpr unsigned buttons_now = 0x2000, position_now = 0x2050, force_now = 0x2700;
constexpr unsigned model_type = 0x2501, driver_version = 0x2502, serial_number = 0x2504, workspace = 0x2550;
constexpr unsigned update_rate = 0x2600, max_stiffness = 0x2602, max_force = 0x2603, force_output = 0x4000,
                   force_clamping = 0x4001;
constexpr unsigned short highest_priority = 0xFFFF;

// Error codes come in hundreds: functions, force, device, frames, scheduler, licence.
Fault fault_of(unsigned code) {
    if (code == 0x0304 || code == 0x0402) return Fault::overrun; // timer; two frames in one tick
    if (code == 0x0302 || code == 0x0303) return Fault::lost;    // no communication
    if (code >> 8 == 2) return Fault::force;
    return Fault::device;
}

class OpenHaptics : public Driver {
    SharedLibrary library;
    const std::string path, wanted;
    unsigned device = no_handle;
    unsigned long callback = 0;
    bool scheduled = false;
    std::atomic<bool> ended{true};

    SharedLibrary::Function<unsigned(const char*)> init{library, "hdInitDevice"};
    SharedLibrary::Function<void(unsigned)> disable{library, "hdDisableDevice"};
    SharedLibrary::Function<void(unsigned)> make_current{library, "hdMakeCurrentDevice"};
    SharedLibrary::Function<void(unsigned)> begin{library, "hdBeginFrame"};
    SharedLibrary::Function<void(unsigned)> end{library, "hdEndFrame"};
    SharedLibrary::Function<void(unsigned, double*)> get_doubles{library, "hdGetDoublev"};
    SharedLibrary::Function<void(unsigned, int*)> get_integers{library, "hdGetIntegerv"};
    SharedLibrary::Function<void(unsigned, const double*)> set_doubles{library, "hdSetDoublev"};
    SharedLibrary::Function<const char*(unsigned)> get_string{library, "hdGetString"};
    SharedLibrary::Function<HdError()> get_error{library, "hdGetError"};
    SharedLibrary::Function<const char*(unsigned)> error_string{library, "hdGetErrorString"};
    SharedLibrary::Function<void(unsigned)> enable{library, "hdEnable"};
    SharedLibrary::Function<unsigned long(Callback, void*, unsigned short)> schedule{library, "hdScheduleAsynchronous"};
    SharedLibrary::Function<void(unsigned long)> unschedule{library, "hdUnschedule"};
    SharedLibrary::Function<void()> start_scheduler{library, "hdStartScheduler"};
    SharedLibrary::Function<void()> stop_scheduler{library, "hdStopScheduler"};

    void load() {
        library.load(path, {"libHD.so", "libHD.so.3.4", "libHD.so.3"},
                     "OpenHaptics' libHD.so was not found; install OpenHaptics and the Touch driver from 3D Systems, "
                     "or name the file with PALPATE_LIBHD");
    }

    void clear_errors() {
        for (int i = 0; i < 64 && get_error().code; i++) {
        }
    }
    std::string error_text(unsigned code) {
        const char* text = error_string(code);
        return text ? text : "error " + std::to_string(code);
    }
    std::string string(unsigned parameter) {
        const char* text = get_string(parameter);
        return text ? text : "";
    }
    double double_value(unsigned parameter, double otherwise) {
        double value[6] = {NAN, 0, 0, 0, 0, 0};
        get_doubles(parameter, value);
        return value[0] > 0 && std::isfinite(value[0]) ? value[0] : otherwise;
    }

    void set_limits() {
        double box[6] = {0, 0, 0, 0, 0, 0};
        device_limits.force = double_value(max_force, 3.3);
        device_limits.stiffness = double_value(max_stiffness, 0.5);
        device_limits.damping = 1e-3 * device_limits.stiffness; // a time constant of one tick
        int rate = 1000;
        get_integers(update_rate, &rate);
        if (rate >= 500 && rate <= 5000) device_limits.period = 1.0 / rate;
        get_doubles(workspace, box);
        for (int k = 0; k < 3; k++) {
            bool known = std::isfinite(box[k]) && std::isfinite(box[k + 3]) && box[k] < box[k + 3];
            double reach =
                known ? 0.25 * (box[k + 3] - box[k]) : 0; // mechanical stops are elastic, and calibration is no better
            device_limits.lowest[k] = known ? box[k] - reach : -500;
            device_limits.highest[k] = known ? box[k + 3] + reach : 500;
        }
        clear_errors(); // what an older library does not know keeps its default value
    }

    // Faults reported since the last call; false if the callback must end.
    bool read_errors() {
        for (int i = 0; i < 16; i++) {
            HdError error = get_error();
            if (!error.code) return true;
            Fault fault = fault_of(error.code);
            if (fault == Fault::lost || fault == Fault::device) {
                servo->lose(fault);
                return false;
            }
            servo->trip(fault);
        }
        return true;
    }

    unsigned tick() {
        double position[3] = {NAN, NAN, NAN}, force[3] = {0, 0, 0};
        const double none[3] = {0, 0, 0};
        int pressed = 0;
        begin(device);
        get_doubles(position_now, position);
        get_integers(buttons_now, &pressed);
        bool good = read_errors();
        if (good && !stopping.load(std::memory_order_acquire)) {
            servo->tick(position, uint8_t(pressed), now_ns(), force);
            set_doubles(force_now, force);
        } else
            set_doubles(force_now, none);
        end(device);
        good = read_errors() && good;
        if (good && !stopping.load(std::memory_order_acquire)) return go_on;
        begin(device); // errors of the frame's end come after its force was new_servo
        set_doubles(force_now, none);
        end(device);
        ended.store(true, std::memory_order_release);
        return finished;
    }
    static unsigned called(void* self) { return static_cast<OpenHaptics*>(self)->tick(); }

public:
    OpenHaptics(std::string path, std::string wanted) : path(std::move(path)), wanted(std::move(wanted)) {}
    ~OpenHaptics() override { stop(); }
    const char* name() const override { return "OpenHaptics"; }

    FoundDevice open() override {
        load();
        clear_errors();
        device = init(wanted.empty() ? nullptr : wanted.c_str());
        HdError error = get_error();
        if (error.code || device == no_handle) {
            device = no_handle;
            throw DriverError("no-device", "OpenHaptics found no device" + (wanted.empty() ? "" : " named " + wanted) +
                                               " (" + error_text(error.code) +
                                               "); connect it, switch it on, and run the maker's set-up");
        }
        make_current(device);
        FoundDevice found{name(), string(model_type), string(serial_number), string(driver_version)};
        set_limits();
        return found;
    }

    void start(Servo& new_servo) override {
        if (device == no_handle) throw DriverError("no-device", "open the device before it is started");
        servo = &new_servo;
        servo->restart();
        stopping = ended = false;
        clear_errors();
        make_current(device);
        enable(force_output);
        enable(force_clamping);
        callback = schedule(&OpenHaptics::called, this, highest_priority);
        scheduled = true;
        start_scheduler();
        if (HdError error = get_error(); error.code) {
            std::string why = error_text(error.code);
            ended = true; // the callback may never have run
            stop();
            throw DriverError("device-fault", "OpenHaptics cannot start its servo loop (" + why + ")");
        }
    }

    void stop() override {
        if (device == no_handle) return;
        stopping.store(true, std::memory_order_release);
        for (int i = 0; i < 200 && !ended; i++) std::this_thread::sleep_for(std::chrono::milliseconds(1));
        if (scheduled) {
            stop_scheduler();
            unschedule(callback);
        }
        disable(device);
        device = no_handle;
        scheduled = false;
        if (servo) servo->lose(Fault::off);
        servo = nullptr;
    }
};

} // namespace

std::unique_ptr<Driver> open_haptics(const std::string& library, const std::string& device) {
    return std::make_unique<OpenHaptics>(library, device);
}

} // namespace palpate
