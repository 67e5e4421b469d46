#pragma once
// Pieces that cuts have freed: rigid bodies beside the tissue, which lie, are carried by tools, or fall. They do not
// turn, and meet nothing. Owned by Simulation and called on its thread, once a tick.
#include "simulation/tool_proxy.h"
#include <vector>

namespace palpate {

constexpr int most_pieces = 16;       // at once
constexpr double gravity = 9810;      // mm/s^2
constexpr double tick_seconds = 1e-3; // of RealtimeLoop
constexpr double back_in_its_bed = 1; // mm: let go so near to where it lay, a piece lies there again

enum class PieceState : uint8_t {
    lying,   // where it came free
    carried, // by tools
    falling, // freely
    gone     // out of the scene
};

struct LoosePiece {
    double weight = 0;   // N
    bool bedded = false; // there is tissue below the place where it came free
    PieceState state = PieceState::lying;
    double offset[3] = {0, 0, 0}; // mm, from where it came free
    double begin[3] = {0, 0, 0};  // mm, `offset` where it began to fall,
    int64_t since = 0;            // and at which tick
};

// The pieces beside a body that was cut. Tools that carry one know its number (ToolProxy::piece).
struct LoosePieces {
    std::vector<LoosePiece> piece;
    std::vector<int> before;                 // (pieces) number of each beside the body before; -1: it is new
    const ContactSurface* surface = nullptr; // of all of them, where they were at rest
    std::vector<int> piece_of;               // (triangles of `surface`)
    double down[3] = {0, 0, -1};             // unit vector
    double depth = 0;                        // mm of a fall after which a piece is gone

    // Goes on from the pieces beside the body before. Tools that carry one which is there no more hold nothing until
    // they are taken away. tick: the next one.
    void go_on_from(const LoosePieces& old, ToolProxy* proxies, int64_t tick);

    // A tool that held the tissue where a piece has come free carries it from now on; false where there is none.
    bool take_over(ToolProxy* proxies, int tool, double tolerance);

    // One tick of one tool; false if it is none of a piece, and the tissue's.
    bool update(ToolProxy* proxies, int tool, const Command& command, const ToolMotion& motion);

    // After all tools: moves what is carried with them, by their mean, and what falls. Each tool bears its part of the
    // weight, so that lifting costs what lowering gives back.
    void advance(ToolProxy* proxies, int64_t tick);

private:
    void take(ToolProxy* proxies, int tool, int number);
    void grip_again(ToolProxy* proxies, int number) const;
};

} // namespace palpate
