#pragma once
// A tool that a hand at another site moves: it goes where the room last said that it is, without steps. Called once a
// tick by RoomDevice, on the loop's thread. As web/src/engine/followed-tool.ts does it in a page.
#include "base/vec3.h"
#include <algorithm>

namespace palpate {

class FollowedTool {
    static constexpr int catch_up = 60; // ticks until it is where the newest news has it: they come 16 ms apart, and
                                        // later when one is lost
    static constexpr double letting_go = 0.04; // of the force, that goes in a tick
    static constexpr double gone = 0.01;       // of the largest force that it had
    static constexpr int longest_leave = 1000; // ticks of letting go
    double target_point[3] = {0, 0, 0}, target[3] = {0, 0, 0};
    double largest = 0;    // N, force on it so far
    double compliance = 0; // mm/N, of the tissue there: its displacement over its force when that was largest
    int left = 0;          // ticks until it is there
    int leaving = -1;      // ticks since it has let go at the room

public:
    double point[3] = {0, 0, 0}, displacement[3] = {0, 0, 0}; // mm

    FollowedTool() = default;
    // tissue: mm, displacement of the tissue at the point, so that nothing moves at first.
    FollowedTool(const double at[3], const double tissue[3]) {
        std::copy_n(at, 3, point), std::copy_n(at, 3, target_point);
        std::copy_n(tissue, 3, displacement), std::copy_n(tissue, 3, target);
    }

    // Where it is at the room.
    void follow(const double at[3], const double by[3]) {
        std::copy_n(at, 3, target_point), std::copy_n(by, 3, target);
        left = catch_up;
        leaving = -1;
    }

    // It has let go at the room. Here its force goes to zero first.
    void leave() { leaving = std::max(leaving, 0); }

    // One tick. force: N, of the tissue on it after the last one. False: it has let go.
    bool advance(const double force[3]) {
        const double size = length(force);
        if (leaving >=
            0) { // the tissue pulls it back: so far each tick, that its force is less by its part in the next
            for (int k = 0; k < 3; k++) displacement[k] += letting_go * compliance * force[k];
            return leaving++ < longest_leave && size > gone * largest;
        }
        if (size > largest) largest = size, compliance = length(displacement) / size;
        if (left == 0) return true;
        for (int k = 0; k < 3; k++) {
            point[k] += (target_point[k] - point[k]) / left;
            displacement[k] += (target[k] - displacement[k]) / left;
        }
        left--;
        return true;
    }
};

} // namespace palpate
