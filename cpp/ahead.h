#pragma once
#include "compliance.h"
#include <thread>

namespace palpate {

// The thread that makes a state's tables where the hand goes: the patch's own blocks first, then those along its way,
// then the nearest of the others, and, while the hand is slow, columns for the display. It also computes what a display
// shows, some thirty times a second.
class Ahead {
public:
    Ahead(const Elastic& elastic, Green& green, Latest<Touch>& touches);
    ~Ahead();
    const float* newest_field() { return fields.reading().data(); } // (vertices, 3) mm; by one thread

private:
    const Elastic& elastic;
    Green& green;
    Latest<Touch>& touches;
    Latest<std::vector<float>> fields;
    Touch touch;
    double centre[3] = {0, 0, 0}, velocity[3] = {0, 0, 0}; // mm, mm a tick
    double breadth = 0;                                    // mm, of the patch
    double reach = 0;                                      // mm, of the blocks wanted
    int64_t since = 0, shown = 0;                          // serial when velocity was taken; of the last field
    bool all_near = false;                                 // every vertex has its blocks
    std::vector<int> on_way, wanted;
    std::vector<std::pair<double, int>> arrival;
    std::atomic<bool> stopping{false};
    std::thread thread;
    void run();
    void look();
    void find_way();
    bool make_near();
    bool make_columns();
    bool make_others();
    void show();
    double speed() const;
};

} // namespace palpate
