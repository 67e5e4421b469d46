#pragma once
// The interface of a maker's driver. Opened, started and stopped by the Python session; while it runs, it calls
// Servo::tick at the device's rate from a thread of its own, with positions in mm of the device's frame.
#include "haptics/servo.h"
#include <atomic>
#include <memory>
#include <stdexcept>
#include <string>

namespace palpate {

// Why a device cannot be used; what() says what to do.
struct DriverError : std::runtime_error {
    std::string fault; // library-missing, wrong-version, service-missing, no-device, device-fault
    DriverError(const char* fault, const std::string& text) : std::runtime_error(text), fault(fault) {}
};

struct FoundDevice {
    std::string driver, model, serial, version;
};

class Driver {
public:
    virtual ~Driver() = default;
    virtual const char* name() const = 0;
    virtual FoundDevice open() = 0;                        // throws DriverError
    virtual void start(Servo& servo) = 0;                  // the servo must outlive the run; throws DriverError
    virtual void stop() = 0;                               // zero force, then the device is closed; may be called twice
    ServoSettings limits() const { return device_limits; } // of the open device, in its own frame

protected:
    ServoSettings device_limits;
    Servo* servo = nullptr;            // while it runs
    std::atomic<bool> stopping{false}; // its thread is to end
};

// `library`: a path, or "" to let the loader find it. `device`: the name given in the maker's set-up, or "".
std::unique_ptr<Driver> open_haptics(const std::string& library, const std::string& device);
// rate: ticks a second.
std::unique_ptr<Driver> force_dimension(const std::string& library, int rate);
std::unique_ptr<Driver> haply(const std::string& host, int port, int rate);

} // namespace palpate
