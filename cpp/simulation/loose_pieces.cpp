#include "simulation/loose_pieces.h"
#include <algorithm>

namespace palpate {
namespace {

bool carries(const ToolProxy& proxy, int number) {
    return proxy.state == ContactState::carrying && proxy.piece == number;
}

} // namespace

void LoosePieces::go_on_from(const LoosePieces& old, ToolProxy* proxies, int64_t tick) {
    int number_now[most_pieces];
    std::fill_n(number_now, most_pieces, -1);
    for (int i = 0; i < int(piece.size()); i++) {
        LoosePiece& p = piece[i];
        if (before[i] < 0) {
            p.state = p.bedded ? PieceState::lying : PieceState::falling;
            p.since = tick;
            continue;
        }
        const double weight = p.weight;
        p = old.piece[before[i]];
        p.weight = weight;
        number_now[before[i]] = i;
    }
    for (int t = 0; t < most_tools; t++) {
        ToolProxy& proxy = proxies[t];
        if (proxy.state != ContactState::carrying) continue;
        proxy.piece = number_now[proxy.piece];
        if (proxy.piece >= 0) continue;
        proxy.clear_forces();
        proxy.state = ContactState::refused;
    }
}

// The mean of all that hold it must stay where it is when one comes or goes.
void LoosePieces::grip_again(ToolProxy* proxies, int number) const {
    for (int t = 0; t < most_tools; t++)
        if (carries(proxies[t], number))
            for (int k = 0; k < 3; k++) proxies[t].grip[k] = piece[number].offset[k] - proxies[t].tip[k];
}

void LoosePieces::take(ToolProxy* proxies, int tool, int number) {
    proxies[tool].state = ContactState::carrying;
    proxies[tool].piece = number;
    proxies[tool].clear_forces();
    piece[number].state = PieceState::carried;
    grip_again(proxies, number);
}

bool LoosePieces::take_over(ToolProxy* proxies, int tool, double tolerance) {
    if (!surface) return false;
    const SurfacePoint at = surface->closest(proxies[tool].at.point);
    if (at.distance > tolerance || before[piece_of[at.triangle]] >= 0) return false;
    take(proxies, tool, piece_of[at.triangle]);
    return true;
}

bool LoosePieces::update(ToolProxy* proxies, int tool, const Command& command, const ToolMotion& motion) {
    ToolProxy& proxy = proxies[tool];
    if (proxy.state == ContactState::carrying && (command.kind != proxy.kind || !is_finite(command))) {
        const int number = proxy.piece;
        proxy = ToolProxy();
        grip_again(proxies, number);
    }
    if (proxy.state != ContactState::carrying) {
        if (command.kind != CommandKind::carry) return false;
        if (proxy.state == ContactState::refused && proxy.kind == CommandKind::carry) return true;
        proxy = ToolProxy();
        proxy.kind = CommandKind::carry;
        proxy.state = ContactState::refused;
        if (!surface || !is_finite(command)) return true;
        const int number = piece_of[surface->closest(command.point).triangle];
        if (piece[number].state == PieceState::gone) return true;
        std::copy_n(command.point, 3, proxy.at.point);
        for (int k = 0; k < 3; k++) proxy.tip[k] = command.point[k] + piece[number].offset[k];
        take(proxies, tool, number);
    }
    double wanted[3];
    for (int k = 0; k < 3; k++) wanted[k] = command.point[k] + command.displacement[k];
    approach(proxy.tip, wanted, motion);
    for (int k = 0; k < 3; k++) proxy.displacement[k] = proxy.tip[k] - proxy.at.point[k];
    return true;
}

void LoosePieces::advance(ToolProxy* proxies, int64_t tick) {
    for (int i = 0; i < int(piece.size()); i++) {
        LoosePiece& p = piece[i];
        double sum[3] = {0, 0, 0};
        int hands = 0;
        for (int t = 0; t < most_tools; t++) {
            if (!carries(proxies[t], i)) continue;
            hands++;
            for (int k = 0; k < 3; k++) sum[k] += proxies[t].tip[k] + proxies[t].grip[k];
        }
        for (int t = 0; t < most_tools; t++)
            if (carries(proxies[t], i))
                for (int k = 0; k < 3; k++) proxies[t].force[k] = p.weight / hands * down[k];
        if (hands > 0) {
            for (int k = 0; k < 3; k++) p.offset[k] = sum[k] / hands;
        } else if (p.state == PieceState::carried) {
            p.state = p.bedded && length(p.offset) < back_in_its_bed ? PieceState::lying : PieceState::falling;
            std::copy_n(p.offset, 3, p.begin);
            p.since = tick;
        } else if (p.state == PieceState::falling) {
            const double seconds = double(tick - p.since) * tick_seconds, way = 0.5 * gravity * seconds * seconds;
            for (int k = 0; k < 3; k++) p.offset[k] = p.begin[k] + way * down[k];
            if (way > depth) p.state = PieceState::gone;
        }
    }
}

} // namespace palpate
