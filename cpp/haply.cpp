// Inverse3 and its kin through Haply's Inverse Service: JSON over a WebSocket on this machine, one state from the
// service for each message to it, so that our messages set the rate.
#include "clock.h"
#include "driver.h"
#include "json.h"
#include "websocket.h"
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <thread>

namespace palpate {
namespace {

constexpr int patience = 5000; // us for an answer, then the force is taken back
constexpr int silence = 200;   // times in a row without one, then the service is gone
constexpr double metre = 1000; // mm

class Haply : public Driver {
    const std::string host;
    const int port, rate;
    WebSocket line;
    char device[40] = "";
    bool introduced = false;
    Servo* servo = nullptr;
    std::atomic<bool> stopping{false};
    std::thread thread;
    ServoSettings nominal;

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
        return line.send({text, size_t(size)});
    }

    // False: the message does not have our device any more.
    bool read(std::string_view text, double position[3], uint8_t& buttons) const {
        Json whole(text), all = whole["inverse3"], state;
        for (int i = 0; i < 16 && all[i].exists(); i++)
            if (all[i]["device_id"].string() == device) state = all[i]["state"];
        if (!state.exists()) return false;
        Json p = state["cursor_position"];
        const char* const axes[] = {"x", "y", "z"};
        for (int k = 0; k < 3; k++) position[k] = metre * p[axes[k]].number(NAN);
        Json grip = whole["wireless_verse_grip"][0]["state"]["buttons"];
        bool first = grip["a"].is_true() || whole["verse_grip"][0]["state"]["button"].is_true();
        buttons = uint8_t(first | grip["b"].is_true() << 1 | grip["c"].is_true() << 2);
        return true;
    }

    void measure(std::string_view type) {
        bool small = type == "minverse";
        nominal.force = small ? 2 : 6; // ours, on the safe side: the service does not say what the device bears
        nominal.stiffness = small ? 0.4 : 0.8;
        nominal.damping = 1e-3 * nominal.stiffness;
        nominal.period = 1.0 / rate;
        for (int k = 0; k < 3; k++) nominal.lowest[k] = -600, nominal.highest[k] = 600;
    }

    // One message read and answered; false when the device is gone.
    bool tick(int& missed, double force[3]) {
        std::string_view text;
        double position[3];
        uint8_t buttons = 0;
        int taken = 0;
        auto got = line.receive(patience, text);
        for (; got == WebSocket::Got::message && taken < 64; taken++) { // the newest, if several lie there
            if (!read(text, position, buttons)) return false;
            got = line.receive(0, text);
        }
        if (got == WebSocket::Got::gone) return false;
        std::fill_n(force, 3, 0.0);
        missed = taken ? 0 : missed + 1; // counted, not timed: all of us may have been paused
        if (taken)
            servo->tick(position, buttons, now_ns(), force);
        else if (missed == silence)
            return false;
        else
            servo->trip(Fault::late); // and zero goes out at once
        return push(force);
    }

    void run() {
        const double none[3] = {0, 0, 0};
        double force[3] = {0, 0, 0};
        int missed = 0;
        bool well = push(none);
        for (Beat beat(rate); well && !stopping.load(std::memory_order_relaxed); beat.wait())
            well = tick(missed, force);
        push(none);
        if (!well) servo->lose(Fault::lost);
        std::string_view text; // until the service has nothing to say it may not have heard us
        for (int i = 0; i < 64 && line.receive(50'000, text) == WebSocket::Got::message; i++) {
        }
    }

public:
    Haply(std::string host, int port, int rate) : host(std::move(host)), port(port), rate(rate) {
        if (rate < 500 || rate > 5000) throw std::invalid_argument("rate: a device ticks 500 to 5000 times a second");
        if (port < 1 || port > 65535) throw std::invalid_argument("port: 1 to 65535");
    }
    ~Haply() override { stop(); }
    const char* name() const override { return "Haply"; }
    ServoSettings bounds() const override { return nominal; }

    Found open() override {
        const std::string where = "ws://" + host + ":" + std::to_string(port);
        if (std::string why = line.open(host, port, 500); !why.empty())
            throw DriverError("service-missing", "Haply's Inverse Service does not answer at " + where + " (" + why +
                                                     "); install Haply Hub and start it");
        std::string_view text;
        introduced = false;
        if (line.receive(1'000'000, text) != WebSocket::Got::message) {
            line.close();
            throw DriverError("wrong-version", "the service at " + where + " does not list its devices as Haply's " +
                                                   "Inverse Service 3.1 does; update Haply Hub");
        }
        Json whole(text), first = whole["inverse3"][0], info = first["config"]["device_info"];
        std::string id(first["device_id"].string()), type(first["config"]["type"].string());
        auto plain = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_'; };
        if (id.empty() || id.size() >= sizeof device || !std::all_of(id.begin(), id.end(), plain)) {
            bool ours = whole["session_id"].exists() || whole["inverse3"].exists();
            line.close();
            if (ours)
                throw DriverError("no-device", "Haply's Inverse Service knows no device; connect an Inverse3 and " +
                                                   std::string("switch it on"));
            throw DriverError("wrong-version",
                              "the service at " + where + " does not speak Haply's JSON 3.1; " + "update Haply Hub");
        }
        std::copy_n(id.c_str(), id.size() + 1, device);
        measure(type);
        auto part = [&](const char* member) { return std::to_string(int(info[member].number(0))); };
        return {name(), type.empty() ? "inverse3" : type, id, part("major_version") + "." + part("minor_version")};
    }

    void start(Servo& given) override {
        if (!device[0]) throw DriverError("no-device", "open the device before it is started");
        servo = &given;
        servo->restart();
        stopping = false;
        thread = std::thread([this] { run(); });
    }

    void stop() override {
        stopping = true;
        if (thread.joinable()) thread.join();
        line.close();
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
