// Omega, Delta, Sigma, Lambda and Falcon through the maker's libdhd. The declarations are ours, written from what its
// reference manual says of each function; the library is the user's.
#include "haptics/shared_library.h"
#include "realtime/periodic_timer.h"
#include <algorithm>
#include <atomic>
#include <cmath>
#include <thread>

namespace palpate {
namespace {

constexpr char any = -1;                 // DHD_DEVICE: the one that was opened last
constexpr unsigned char off = 0, on = 1; // DHD_OFF, DHD_ON
constexpr double mm_per_m = 1000;        // mm

// The maker's data sheets: continuous force (N). The library does not say it.
struct Kind {
    const char* text;
    double force;
};
constexpr Kind kinds[] = {{"omega", 12}, {"delta", 20}, {"sigma", 20}, {"lambda", 20}, {"falcon", 8}};

class ForceDimension : public Driver {
    SharedLibrary library;
    const std::string path;
    const int rate;
    int device = -1;
    std::thread thread;

    SharedLibrary::Function<int()> dhd_open{library, "dhdOpen"};
    SharedLibrary::Function<int(char)> dhd_close{library, "dhdClose"};
    SharedLibrary::Function<int(double*, double*, double*, char)> get_position{library, "dhdGetPosition"};
    SharedLibrary::Function<int(double, double, double, char)> set_force{library, "dhdSetForce"};
    SharedLibrary::Function<int(int, char)> get_button{library, "dhdGetButton"};
    SharedLibrary::Function<int(unsigned char, char)> enable_force{library, "dhdEnableForce"};
    SharedLibrary::Function<const char*()> last_error{library, "dhdErrorGetLastStr"};
    SharedLibrary::Function<const char*(char)> system_name{library, "dhdGetSystemName"};
    SharedLibrary::Function<int(unsigned short*, char)> serial_number{library, "dhdGetSerialNumber"};
    SharedLibrary::Function<void(int*, int*, int*, int*)> sdk_version{library, "dhdGetSDKVersion"};

    void load() {
        library.load(path, {"libdhd.so", "libdhd.so.3"},
                     "Force Dimension's libdhd.so was not found; install the Force Dimension SDK, "
                     "or name the file with PALPATE_LIBDHD");
    }

    std::string error_text() {
        const char* text = last_error();
        return text ? text : "no reason new_servo";
    }

    void set_limits(std::string model) {
        for (char& c : model) c = char(std::tolower(static_cast<unsigned char>(c)));
        device_limits.force = 8;
        for (const Kind& kind : kinds)
            if (model.find(kind.text) != std::string::npos) device_limits.force = kind.force;
        device_limits.stiffness = 2; // N/mm; the sheets say up to 14.5, of the closed loop inside the device
        device_limits.damping = 1e-3 * device_limits.stiffness;
        device_limits.period = 1.0 / rate;
        for (int k = 0; k < 3; k++) device_limits.lowest[k] = -300, device_limits.highest[k] = 300;
    }

    // One reading in, one force out; false when the device is gone.
    bool tick() {
        double p[3] = {NAN, NAN, NAN}, force[3] = {0, 0, 0};
        if (get_position(p, p + 1, p + 2, any) < 0) { // 0, or 1 where the library paces itself
            servo->lose(Fault::lost);
            return false;
        }
        for (double& x : p) x *= mm_per_m;
        int pressed = get_button(0, any);
        servo->tick(p, pressed > 0, now_ns(), force);
        if (set_force(force[0], force[1], force[2], any) < 0) { // 0, or 2 where a motor is at its limit
            servo->lose(Fault::device);
            return false;
        }
        return true;
    }

    void run() {
        for (PeriodicTimer timer(rate); !stopping.load(std::memory_order_relaxed) && tick();) timer.wait();
        set_force(0, 0, 0, any); // a device that is lost may return with its last force
        enable_force(off, any);
    }

public:
    ForceDimension(std::string path, int rate) : path(std::move(path)), rate(rate) {
        if (rate < 500 || rate > 5000) throw std::invalid_argument("rate: a device ticks 500 to 5000 times a second");
    }
    ~ForceDimension() override { stop(); }
    const char* name() const override { return "Force Dimension"; }

    FoundDevice open() override {
        load();
        device = dhd_open();
        if (device < 0)
            throw DriverError("no-device", "libdhd found no Force Dimension device (" + error_text() +
                                               "); connect it, switch it on, and calibrate it");
        const char* model = system_name(any);
        unsigned short serial = 0;
        int v[4] = {0, 0, 0, 0};
        sdk_version(v, v + 1, v + 2, v + 3);
        FoundDevice found{name(), model ? model : "unknown",
                          serial_number(&serial, any) < 0 ? "" : std::to_string(serial),
                          std::to_string(v[0]) + "." + std::to_string(v[1]) + "." + std::to_string(v[2])};
        set_limits(found.model);
        return found;
    }

    void start(Servo& new_servo) override {
        if (device < 0) throw DriverError("no-device", "open the device before it is started");
        servo = &new_servo;
        servo->restart();
        if (set_force(0, 0, 0, any) < 0 || enable_force(on, any) < 0)
            throw DriverError("device-fault", "the Force Dimension device takes no force (" + error_text() + ")");
        stopping = false;
        thread = std::thread([this] { run(); });
    }

    void stop() override {
        stopping = true;
        if (thread.joinable()) thread.join();
        if (device >= 0) dhd_close(any);
        device = -1;
        if (servo) servo->lose(Fault::off);
        servo = nullptr;
    }
};

} // namespace

std::unique_ptr<Driver> force_dimension(const std::string& library, int rate) {
    return std::make_unique<ForceDimension>(library, rate);
}

} // namespace palpate
