#include "ahead.h"
#include <algorithm>
#include <chrono>
#include <cmath>
#ifdef __linux__
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

namespace palpate {
namespace {

using clock = std::chrono::steady_clock;
constexpr auto frame = std::chrono::milliseconds(33);
constexpr auto idle = std::chrono::microseconds(200);
constexpr int foresight = 200;    // ticks that the hand's way is followed
constexpr double slow = 0.01;     // mm a tick: below it there is time for columns
constexpr double generous = 1.25; // of the patch's breadth: blocks reach so far, as patches differ from place to place

} // namespace

Ahead::Ahead(const Elastic& elastic, Green& green, Latest<Touch>& touches)
    : elastic(elastic), green(green), touches(touches),
      fields(std::vector<float>(3 * size_t(elastic.vertices()), 0.0f)) {
    thread = std::thread([this] { run(); });
}

Ahead::~Ahead() {
    stopping = true;
    thread.join();
}

void Ahead::run() {
#ifdef __linux__
    setpriority(PRIO_PROCESS, id_t(syscall(SYS_gettid)), 5); // this thread's alone: the ticks come first
#endif
    auto due = clock::now();
    while (!stopping.load(std::memory_order_relaxed)) {
        look();
        if (clock::now() >= due && touch.serial != shown) {
            show();
            due = clock::now() + frame;
        }
        if (touch.count > 0) {
            find_way();
            if (make_near()) continue;
            if (speed() < slow && make_columns()) continue;
        }
        if (reach > 0 && make_others()) continue;
        std::this_thread::sleep_for(idle);
    }
}

double Ahead::speed() const {
    return std::sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2]);
}

// The newest patch: where it is, how broad, how fast.
void Ahead::look() {
    if (!touches.waiting()) return;
    const bool held = touch.count > 0;
    touch.copy(touches.reading());
    if (touch.count == 0) {
        std::fill_n(velocity, 3, 0.0);
        return;
    }
    double now[3] = {0, 0, 0};
    for (int k = 0; k < touch.count; k++)
        for (int c = 0; c < 3; c++) now[c] += touch.weight[k] * elastic.position[3 * size_t(touch.vertex[k]) + c];
    breadth = 0;
    for (int i = 0; i < touch.count; i++)
        for (int j = 0; j < i; j++) breadth = std::max(breadth, elastic.apart(touch.vertex[i], touch.vertex[j]));
    if (generous * breadth > reach) reach = generous * generous * breadth, all_near = false;
    const int64_t ticks = touch.serial - since;
    if (!held || ticks >= 5) {
        for (int c = 0; c < 3; c++) {
            velocity[c] = held ? 0.5 * velocity[c] + 0.5 * (now[c] - centre[c]) / double(ticks) : 0;
            centre[c] = now[c];
        }
        since = touch.serial;
    }
}

// Vertices that the patch may meet, by the way until it does: what lies ahead counts once, sideways twice, behind three
// times, as hands turn. Around a hand that rests, as far as the patch is broad.
void Ahead::find_way() {
    on_way.clear();
    arrival.clear();
    const double pace = speed(), scale = pace > 0 ? 1 / pace : 0;
    for (int v = 0; v < elastic.vertices(); v++) {
        double along = 0, square = 0;
        for (int c = 0; c < 3; c++) {
            const double d = elastic.position[3 * size_t(v) + c] - centre[c];
            along += d * velocity[c] * scale;
            square += d * d;
        }
        const double way = 2 * std::sqrt(square) - along;
        if (way <= pace * foresight + 2 * breadth) arrival.push_back({way, v});
    }
    std::sort(arrival.begin(), arrival.end());
    for (const auto& [when, v] : arrival) on_way.push_back(v);
}

// Blocks of the first few that lack them: the patch's own, then those on its way.
bool Ahead::make_near() {
    wanted.assign(touch.vertex, touch.vertex + touch.count);
    wanted.insert(wanted.end(), on_way.begin(), on_way.end());
    int lacking[Green::batch], count = 0;
    for (int v : wanted) {
        if (green.near_made(v, generous * breadth) || std::find(lacking, lacking + count, v) < lacking + count)
            continue;
        lacking[count++] = v;
        if (count == Green::batch) break;
    }
    if (count == 0) return false;
    green.use(wanted.data(), int(wanted.size()));
    green.make_near(lacking, count, reach);
    return true;
}

bool Ahead::make_columns() {
    int lacking[2], count = 0;
    for (int k = 0; k < touch.count && count < 2; k++)
        if (!green.columns(touch.vertex[k])) lacking[count++] = touch.vertex[k];
    if (count == 0 || green.columns_would_not_fit(touch.count)) return false;
    green.use(touch.vertex, touch.count);
    green.make_columns(lacking, count);
    return true;
}

// Blocks of the vertices nearest to where the hand is or last was.
bool Ahead::make_others() {
    if (all_near || !green.room()) return false;
    arrival.clear();
    for (int v = 0; v < elastic.vertices(); v++) {
        if (green.near_made(v, reach)) continue;
        double square = 0;
        for (int c = 0; c < 3; c++) {
            const double d = elastic.position[3 * size_t(v) + c] - centre[c];
            square += d * d;
        }
        arrival.push_back({square, v});
    }
    all_near = arrival.empty();
    if (all_near) return false;
    const int count = int(std::min<size_t>(Green::batch, arrival.size()));
    std::partial_sort(arrival.begin(), arrival.begin() + count, arrival.end());
    int lacking[Green::batch];
    for (int k = 0; k < count; k++) lacking[k] = arrival[k].second;
    green.make_near(lacking, count, reach);
    return true;
}

void Ahead::show() {
    float* out = fields.writing().data();
    if (touch.count == 0)
        std::fill_n(out, 3 * size_t(elastic.vertices()), 0.0f);
    else if (!Compliance::contract(green, touch, elastic.vertices(), out))
        green.solve(touch.vertex, touch.count, touch.load, out);
    fields.publish();
    shown = touch.serial;
}

} // namespace palpate
