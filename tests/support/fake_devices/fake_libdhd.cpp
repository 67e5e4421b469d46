// A stand-in for Force Dimension's libdhd.so with the functions that palpate calls: each reading is a tick. Metres and
// newtons.
#include "fake_hand.h"

namespace {
bool open = false;
const char* reason = "no error";
bool is(bool Hand::*what) {
    Hold hold(hand());
    return hand().*what;
}
} // namespace

extern "C" {

int dhdOpen() {
    if (is(&Hand::absent)) {
        reason = "no device found";
        return -1;
    }
    open = true;
    return 0;
}
int dhdClose(char) {
    open = false;
    hand().closed++;
    return 0;
}
int dhdGetPosition(double* x, double* y, double* z, char) {
    hand().begin();
    if (!open) hand().misuse++;
    if (is(&Hand::unplugged)) {
        reason = "communication error";
        return -1;
    }
    Hold hold(hand());
    double* out[3] = {x, y, z};
    for (int k = 0; k < 3; k++) *out[k] = hand().absurd ? 1e6 : hand().position[k] / 1000;
    return hand().ticks % 50 == 0; // now and then the library held us back
}
int dhdSetForce(double x, double y, double z, char) {
    if (!open || !isfinite(x + y + z)) hand().misuse++;
    hand().ask(x, y, z);
    hand().end();
    if (is(&Hand::overrun)) {
        reason = "device fault";
        return -1;
    }
    return is(&Hand::unplugged) ? -1 : is(&Hand::warm) ? 2 : 0; // 2: a motor is at its limit
}
int dhdGetButton(int, char) {
    Hold hold(hand());
    return hand().unplugged ? -1 : hand().buttons & 1;
}
int dhdEnableForce(unsigned char on, char) {
    hand().enabled = on;
    return is(&Hand::refuses) ? -1 : 0;
}
const char* dhdErrorGetLastStr() { return reason; }
const char* dhdGetSystemName(char) { return "omega.3"; }
int dhdGetSerialNumber(unsigned short* out, char) {
    *out = 4711;
    return 0;
}
void dhdGetSDKVersion(int* major, int* minor, int* release, int* revision) {
    *major = 3, *minor = 17, *release = 1, *revision = 0;
}
}
