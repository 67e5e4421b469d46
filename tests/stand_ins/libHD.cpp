// A stand-in for OpenHaptics' libHD.so with the functions that palpate calls: a scheduler thread at 1 kHz, frames,
// an error stack, and complaints about calls that the real one forbids.
#include "hand.h"
#include <deque>

namespace {

struct Error {
    unsigned code;
    int internal;
    unsigned device;
};
constexpr unsigned handle = 1, no_handle = 0xFFFFFFFF;

std::deque<unsigned> errors; // under the hand's gate
unsigned (*callback)(void*) = nullptr;
void* argument = nullptr;
std::thread scheduler;
std::atomic<bool> running{false};
bool open = false, in_frame = false;

void complain(unsigned code) {
    std::lock_guard<std::mutex> hold(hand().gate);
    errors.push_back(code);
}
void misuse() {
    std::lock_guard<std::mutex> hold(hand().gate);
    hand().misuse++;
}
bool is(bool Hand::*what) {
    std::lock_guard<std::mutex> hold(hand().gate);
    return hand().*what;
}

void loop() {
    while (running) {
        auto began = std::chrono::steady_clock::now();
        hand().begin();
        if (is(&Hand::unplugged)) complain(0x0302);
        if (is(&Hand::overrun)) complain(0x0304);
        if (is(&Hand::warm)) complain(0x0200);
        bool goes_on = callback && callback(argument) == 1;
        hand().end();
        if (!goes_on) callback = nullptr;
        std::this_thread::sleep_until(began + std::chrono::milliseconds(1)); // never two close together
    }
}

} // namespace

extern "C" {

unsigned hdInitDevice(const char* name) {
    if (open || is(&Hand::absent) || (name && std::strcmp(name, "Default Device"))) {
        complain(0x0300);
        return no_handle;
    }
    open = true;
    return handle;
}
void hdDisableDevice(unsigned device) {
    if (!open || device != handle || running) misuse();
    open = false;
    hand().closed++;
}
void hdMakeCurrentDevice(unsigned device) {
    if (device != handle) misuse();
}
void hdBeginFrame(unsigned device) {
    if (!open || in_frame || device != handle) misuse();
    in_frame = true;
}
void hdEndFrame(unsigned) {
    if (!in_frame) misuse();
    in_frame = false;
    if (is(&Hand::unplugged)) complain(0x0302);
}
void hdGetDoublev(unsigned what, double* out) {
    if (what == 0x2050) {
        if (!in_frame) misuse();
        if (is(&Hand::unplugged)) return; // as it was
        std::lock_guard<std::mutex> hold(hand().gate);
        for (int k = 0; k < 3; k++) out[k] = hand().absurd ? NAN : hand().position[k];
    } else if (what == 0x2602)
        *out = 0.4;
    else if (what == 0x2603)
        *out = 3.2;
    else if (what == 0x2550) {
        const double box[6] = {-200, -100, -100, 200, 250, 130};
        std::memcpy(out, box, sizeof box);
    } else
        complain(0x0100);
}
void hdGetIntegerv(unsigned what, int* out) {
    if (what == 0x2000) {
        std::lock_guard<std::mutex> hold(hand().gate);
        *out = hand().buttons;
    } else if (what == 0x2600)
        *out = 1000;
    else
        complain(0x0100);
}
void hdSetDoublev(unsigned what, const double* in) {
    if (what != 0x2700 || !in_frame) return misuse();
    for (int k = 0; k < 3; k++)
        if (!std::isfinite(in[k])) misuse();
    hand().ask(in[0], in[1], in[2]);
}
const char* hdGetString(unsigned what) {
    return what == 0x2501 ? "Stand-in Touch" : what == 0x2504 ? "SN-0001" : what == 0x2502 ? "3.4.0" : "";
}
Error hdGetError() {
    std::lock_guard<std::mutex> hold(hand().gate);
    if (errors.empty()) return {0, 0, handle};
    unsigned code = errors.back();
    errors.pop_back();
    return {code, 17, handle};
}
const char* hdGetErrorString(unsigned code) { return code == 0x0300 ? "Device fault" : "Some error"; }
void hdEnable(unsigned what) {
    if (what == 0x4000) hand().enabled = true;
}
unsigned long hdScheduleAsynchronous(unsigned (*given)(void*), void* with, unsigned short) {
    if (running) misuse();
    callback = given;
    argument = with;
    return 7;
}
void hdStartScheduler() {
    if (is(&Hand::refuses)) return complain(0x0304);
    running = true;
    scheduler = std::thread(loop);
}
void hdStopScheduler() {
    running = false;
    if (scheduler.joinable()) scheduler.join();
}
void hdUnschedule(unsigned long which) {
    if (which != 7 || running) misuse();
    callback = nullptr;
}
}
