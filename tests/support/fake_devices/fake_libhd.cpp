// A stand-in for OpenHaptics' libHD.so with the functions that palpate calls: a scheduler thread at 1 kHz, frames,
// an error stack, and complaints about calls that the real one forbids.
#include "fake_hand.h"
#include <atomic>

namespace {

struct Error {
    unsigned code;
    int internal;
    unsigned device;
};
constexpr unsigned handle = 1, no_handle = 0xFFFFFFFF;

unsigned errors[64]; // a stack, under the hand's gate
int stacked = 0;
unsigned (*callback)(void*) = nullptr;
void* argument = nullptr;
pthread_t scheduler;
std::atomic<bool> running{false};
bool open = false, in_frame = false;

void complain(unsigned code) {
    Hold hold(hand());
    if (stacked < 64) errors[stacked++] = code;
}
void misuse() {
    Hold hold(hand());
    hand().misuse++;
}
bool is(bool Hand::*what) {
    Hold hold(hand());
    return hand().*what;
}

void* loop(void*) {
    while (running) {
        int64_t began = now();
        hand().begin();
        if (is(&Hand::unplugged)) complain(0x0302);
        if (is(&Hand::overrun)) complain(0x0304);
        if (is(&Hand::warm)) complain(0x0200);
        bool goes_on = callback && callback(argument) == 1;
        hand().end();
        if (!goes_on) callback = nullptr;
        sleep_until(began + 1000000); // never two close together
    }
    return nullptr;
}

} // namespace

extern "C" {

unsigned hdInitDevice(const char* name) {
    if (open || is(&Hand::absent) || (name && strcmp(name, "Default Device"))) {
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
    Hold hold(hand());
    if ((hand().unplugged || hand().snaps) && stacked < 64) errors[stacked++] = 0x0302;
    hand().snaps = false; // said once
}
void hdGetDoublev(unsigned what, double* out) {
    if (what == 0x2050) {
        if (!in_frame) misuse();
        if (is(&Hand::unplugged)) return; // as it was
        Hold hold(hand());
        for (int k = 0; k < 3; k++) out[k] = hand().absurd ? NAN : hand().position[k];
    } else if (what == 0x2602)
        *out = 0.4;
    else if (what == 0x2603)
        *out = 3.2;
    else if (what == 0x2550) {
        const double box[6] = {-200, -100, -100, 200, 250, 130};
        memcpy(out, box, sizeof box);
    } else
        complain(0x0100);
}
void hdGetIntegerv(unsigned what, int* out) {
    if (what == 0x2000) {
        Hold hold(hand());
        *out = hand().buttons;
    } else if (what == 0x2600)
        *out = 1000;
    else
        complain(0x0100);
}
void hdSetDoublev(unsigned what, const double* in) {
    if (what != 0x2700 || !in_frame) return misuse();
    for (int k = 0; k < 3; k++)
        if (!isfinite(in[k])) misuse();
    hand().ask(in[0], in[1], in[2]);
}
const char* hdGetString(unsigned what) {
    return what == 0x2501 ? "Stand-in Touch" : what == 0x2504 ? "SN-0001" : what == 0x2502 ? "3.4.0" : "";
}
Error hdGetError() {
    Hold hold(hand());
    return stacked ? Error{errors[--stacked], 17, handle} : Error{0, 0, handle};
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
    pthread_create(&scheduler, nullptr, loop, nullptr);
}
void hdStopScheduler() {
    if (running.exchange(false)) pthread_join(scheduler, nullptr);
}
void hdUnschedule(unsigned long which) {
    if (which != 7 || running) misuse();
    callback = nullptr;
}
}
