// Inverse3 and its kin through Haply's Inverse Service: JSON over a WebSocket on this machine, one state from the
// service for each message to it, so that our messages set the rate.
#include "haptics/driver.h"
#include "net/json_reader.h"
#include "net/websocket_client.h"
#include "realtime/periodic_timer.h"
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <thread>

namespace palpate {
namespace {

constexpr int timeout_us = 5000;  // us to wait for an answer, then the force is zero
constexpr int max_missed = 200;   // answers in a row, then the service is gone
constexpr double mm_per_m = 1000; // mm

class Haply : public Driver {
    const std::string host;
    const int port, rate;
    WebSocketClient socket;
    char device[40] = "";
    bool introduced = false;
    std::thread thread;

    // Millionths of a newton as whole numbers: printing fractions follows the locale.
    static int newtons(char* out, size_t size, double force) {
        long long millionths = std::llround(force * 1e6), whole = std::llabs(millionths);
        return std::snprintf(out, size, "%s%lld.%06lld", millionths < 0 ? "-" : "", whole / 1000000, whole % 1000000);
    }

    bool push(const double force[3]) {
        char text[512], part[3][40];
        for (int k = 0; k < 3; k++) newtons(part[k], sizeof part[k], force[k]);
        int size =
            std::snprintf(text, sizeof text,
                          "{%s\"inverse3\":[{\"device_id\":\"%s\",\"commands\":{\"set_cursor_force\":{\"vector\":"
                          "{\"x\":%s,\"y\":%s,\"z\":%s}}}}]}",
                          introduced ? "" : "\"session\":{\"configure\":{\"profile\":{\"name\":\"palpate\"}}},", device,
                          part[0], part[1], part[2]);
        introduced = true;
        return socket.send({text, size_t(size)});
    }

    // False: the message does not have our device any more.
    bool read(std::string_view text, double position[3], uint8_t& buttons) const {
        JsonReader whole(text), all = whole["inverse3"], state;
        for (int i = 0; i < 16 && all[i].exists(); i++)
            if (all[i]["device_id"].string() == device) state = all[i]["state"];
        if (!state.exists()) return false;
        JsonReader p = state["cursor_position"];
        const char* const axes[] = {"x", "y", "z"};
        for (int k = 0; k < 3; k++) position[k] = mm_per_m * p[axes[k]].number(NAN);
        JsonReader grip = whole["wireless_verse_grip"][0]["state"]["buttons"];
        bool first = grip["a"].is_true() || whole["verse_grip"][0]["state"]["button"].is_true();
        buttons = uint8_t(first | grip["b"].is_true() << 1 | grip["c"].is_true() << 2);
        return true;
    }

    void set_limits(std::string_view type) {
        bool small = type == "minverse";
        device_limits.force = small ? 2 : 6; // ours, conservative: the service does not report limits
        device_limits.stiffness = small ? 0.4 : 0.8;
        device_limits.damping = 1e-3 * device_limits.stiffness;
        device_limits.period = 1.0 / rate;
        for (int k = 0; k < 3; k++) device_limits.lowest[k] = -600, device_limits.highest[k] = 600;
    }

    // One message read and answered; false when the device is gone.
    bool tick(int& missed, double force[3]) {
        std::string_view text;
        double position[3];
        uint8_t buttons = 0;
        int taken = 0;
        auto got = socket.receive(timeout_us, text);
        for (; got == WebSocketClient::Received::message && taken < 64; taken++) { // the newest, if several have come
            if (!read(text, position, buttons)) return false;
            got = socket.receive(0, text);
        }
        if (got == WebSocketClient::Received::closed) return false;
        std::fill_n(force, 3, 0.0);
        missed = taken ? 0 : missed + 1; // counted, not timed: the whole machine may have been paused
        if (taken)
            servo->tick(position, buttons, now_ns(), force);
        else if (missed == max_missed)
            return false;
        else
            servo->trip(Fault::late); // and zero is sent at once
        return push(force);
    }

    void run() {
        const double none[3] = {0, 0, 0};
        double force[3] = {0, 0, 0};
        int missed = 0;
        bool good = push(none);
        for (PeriodicTimer timer(rate); good && !stopping.load(std::memory_order_relaxed); timer.wait())
            good = tick(missed, force);
        push(none);
        if (!good) servo->lose(Fault::lost);
        std::string_view text; // the service has read our zero when it has nothing more to send
        for (int i = 0; i < 64 && socket.receive(50'000, text) == WebSocketClient::Received::message; i++) {
        }
    }

public:
    Haply(std::string host, int port, int rate) : host(std::move(host)), port(port), rate(rate) {
        if (rate < 500 || rate > 5000) throw std::invalid_argument("rate: a device ticks 500 to 5000 times a second");
        if (port < 1 || port > 65535) throw std::invalid_argument("port: 1 to 65535");
    }
    ~Haply() override { stop(); }
    const char* name() const override { return "Haply"; }

    FoundDevice open() override {
        const std::string where = "ws://" + host + ":" + std::to_string(port);
        if (std::string why = socket.open(host, port, 500); !why.empty())
            throw DriverError("service-missing", "Haply's Inverse Service does not answer at " + where + " (" + why +
                                                     "); install Haply Hub and start it");
        std::string_view text;
        introduced = false;
        if (socket.receive(1'000'000, text) != WebSocketClient::Received::message) {
            socket.close();
            throw DriverError("wrong-version", "the service at " + where + " does not list its devices as Haply's " +
                                                   "Inverse Service 3.1 does; update Haply Hub");
        }
        JsonReader whole(text), first = whole["inverse3"][0], info = first["config"]["device_info"];
        std::string id(first["device_id"].string()), type(first["config"]["type"].string());
        auto plain = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_'; };
        if (id.empty() || id.size() >= sizeof device || !std::all_of(id.begin(), id.end(), plain)) {
            bool ours = whole["session_id"].exists() || whole["inverse3"].exists();
            socket.close();
            if (ours)
                throw DriverError("no-device", "Haply's Inverse Service knows no device; connect an Inverse3 and " +
                                                   std::string("switch it on"));
            throw DriverError("wrong-version",
                              "the service at " + where + " does not speak Haply's JSON 3.1; " + "update Haply Hub");
        }
        std::copy_n(id.c_str(), id.size() + 1, device);
        set_limits(type);
        auto part = [&](const char* member) { return std::to_string(int(info[member].number(0))); };
        return {name(), type.empty() ? "inverse3" : type, id, part("major_version") + "." + part("minor_version")};
    }

    void start(Servo& new_servo) override {
        if (!device[0]) throw DriverError("no-device", "open the device before it is started");
        servo = &new_servo;
        servo->restart();
        stopping = false;
        thread = std::thread([this] { run(); });
    }

    void stop() override {
        stopping = true;
        if (thread.joinable()) thread.join();
        socket.close();
        device[0] = 0;
        if (servo) servo->lose(Fault::off);
        servo = nullptr;
    }
};

} // namespace

std::unique_ptr<Driver> haply(const std::string& host, int port, int rate) {
    return std::make_unique<Haply>(host, port, rate);
}

} // namespace palpate
