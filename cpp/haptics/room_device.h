#pragma once
// A force-feedback device at one site of a room, as the loop of that site sees it: tool 0 is the hand's own, the others
// go where the room says that the other hands are. Called on the loop's thread; another thread tells what the room
// says. No force comes from there: the hand meets the organ that this loop computes. When the room is silent for longer
// than it should, counted in ticks, the force is withdrawn, whatever that thread does meanwhile.
#include "haptics/followed_tool.h"
#include "haptics/servo_device.h"
#include "realtime/triple_buffer.h"

namespace palpate {

struct RoomTool {                                                                    // where the room has a tool
    int64_t hand = 0;                                                                // whose it is; 0: nobody's
    double point[3] = {0, 0, 0}, displacement[3] = {0, 0, 0}, tissue[3] = {0, 0, 0}; // mm; FollowedTool's
};

struct RoomNews {
    RoomTool tool[most_tools]; // the first: this hand's, where it follows the room
    int64_t begun = 0;         // counts how often the hand had to begin anew: it touches once it has been outside
    int patience = 0;          // ticks until the next news, after which the force is withdrawn
    bool withheld = true;      // no force is shown
    bool stopped = false;      // the hand's own tool is not there, unless it follows the room
};

class RoomDevice : public Device {
    ServoDevice own;
    TripleBuffer<RoomNews> newest;
    RoomNews news;
    FollowedTool followed[most_tools];
    int64_t hand[most_tools] = {}; // whose tool it follows
    double felt[most_tools][3] = {};
    int64_t begun = 0;
    int silent = 0; // ticks since the news
    Commands now;

    // A tool of somebody else, or this hand's where it follows the room.
    void follow(int t) {
        const RoomTool& told = news.tool[t];
        if (hand[t] && told.hand != hand[t])
            followed[t].leave();
        else if (hand[t] && silent == 0)
            followed[t].follow(told.point, told.displacement);
        if (!hand[t] && told.hand) {
            hand[t] = told.hand;
            followed[t] = FollowedTool(told.point, told.tissue);
            followed[t].follow(told.point, told.displacement);
        }
        Command& tool = now.tool[t];
        const bool there = hand[t] && followed[t].advance(felt[t]);
        if (!there) hand[t] = 0;
        tool.kind = there ? CommandKind::hold : CommandKind::away;
        std::copy_n(followed[t].point, 3, tool.point);
        std::copy_n(followed[t].displacement, 3, tool.displacement);
    }

public:
    explicit RoomDevice(Servo& servo) : own(servo) {}
    std::atomic<double>& edge() { return own.edge; } // mm that its blade is deep; 0: it has none

    void tell(const RoomNews& told) { // from one thread only
        newest.write_slot() = told;
        newest.publish();
    }

    const Commands& read_commands(int64_t tick) override {
        silent++;
        if (newest.has_new()) news = newest.latest(), silent = 0;
        for (int t = 1; t < most_tools; t++) follow(t);
        const Commands& hands = own.read_commands(tick);
        now.serial = hands.serial;
        if (news.tool[0].hand) {
            follow(0);
        } else {
            hand[0] = 0;
            now.tool[0] = hands.tool[0];
            if (news.stopped || begun != news.begun) now.tool[0].kind = CommandKind::away;
            begun = news.begun;
        }
        own.withdrawn = news.withheld || news.stopped || news.tool[0].hand || silent >= news.patience;
        return now;
    }

    void write_feedback(const Feedback* feedback) override {
        own.write_feedback(feedback);
        for (int t = 0; t < most_tools; t++) std::copy_n(feedback[t].force, 3, felt[t]);
    }
};

} // namespace palpate
