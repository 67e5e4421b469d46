#include "net/websocket_client.h"
#include "base/platform.h"
#include "net/sha1.h"
#include "realtime/periodic_timer.h"
#include <algorithm>
#include <cstring>
#include <random>

namespace palpate {
namespace {

constexpr uint8_t continued = 0, text_frame = 1, closing = 8, ping = 9, pong = 10;

} // namespace

std::string websocket_accept(const std::string& key) {
    return base64(sha1(key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"));
}

std::string WebSocketClient::open(const std::string& host, int port, int timeout_ms) {
    close();
    std::string why = connect_tcp(host, port, int64_t(timeout_ms) * 1000000, socket);
    if (why.empty()) why = handshake(host, port, timeout_ms);
    if (!why.empty()) close();
    return why;
}

std::string WebSocketClient::handshake(const std::string& host, int port, int timeout_ms) {
    std::random_device chance;
    std::string key;
    for (int i = 0; i < 16; i++) key += char(chance());
    key = base64(key);
    mask = chance() | 1;
    std::string hello = "GET / HTTP/1.1\r\nHost: " + host + ":" + std::to_string(port) +
                        "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                        "Sec-WebSocket-Key: " +
                        key + "\r\n\r\n";
    have = length = 0;
    if (!send_bytes(socket, hello.data(), hello.size())) return "it closed the connection";
    const int64_t until = now_ns() + int64_t(timeout_ms) * 1000000;
    for (;;) {
        std::string_view answer(reinterpret_cast<const char*>(in.data()), have);
        size_t end = answer.find("\r\n\r\n");
        if (end != std::string_view::npos) {
            answer = answer.substr(0, end);
            bool well =
                answer.substr(0, 12) == "HTTP/1.1 101" && answer.find(websocket_accept(key)) != std::string_view::npos;
            if (!well) return "it is no WebSocket server";
            have -= end + 4;
            std::memmove(in.data(), in.data() + end + 4, have);
            return "";
        }
        if (have > 8192) return "it is no WebSocket server";
        if (now_ns() >= until) return "it does not answer";
        if (!fill(until)) return "it closed the connection";
    }
}

bool WebSocketClient::fill(int64_t until_ns) {
    if (!wait_readable(socket, until_ns - now_ns())) return true;
    const int got = receive_bytes(socket, in.data() + have, in.size() - have);
    if (got < 0) return got == would_block;
    have += size_t(got);
    return got > 0;
}

// Takes one frame off the front of what has come.
WebSocketClient::Received WebSocketClient::read_frame(std::string_view& text) {
    if (have < 2) return Received::nothing;
    size_t head = 2, size = in[1] & 127;
    if (in[1] & 128 || in[0] & 0x70) return Received::closed; // servers do not mask; we asked for no extension
    if (size >= 126) {
        size_t digits = size == 126 ? 2 : 8;
        if (have < 2 + digits) return Received::nothing;
        size = 0;
        for (size_t i = 0; i < digits; i++) size = size << 8 | in[2 + i];
        head += digits;
    }
    if (size > max_message) return Received::closed;
    if (have < head + size) return Received::nothing;
    const bool last = in[0] & 128;
    const uint8_t opcode = in[0] & 15;
    const char* body = reinterpret_cast<const char*>(in.data() + head);
    Received got = Received::nothing;
    if (opcode == text_frame || opcode == continued) {
        if (opcode == text_frame) length = 0;
        if (length + size > max_message) return Received::closed;
        std::memcpy(message.data() + length, body, size);
        length += size;
        if (last) {
            text = {reinterpret_cast<const char*>(message.data()), length};
            got = Received::message;
        }
    } else if (opcode == ping) {
        if (size > 125 || !send_frame(pong, {body, size})) return Received::closed;
    } else if (opcode != pong)
        return Received::closed; // it closes, or sends what we cannot read
    have -= head + size;
    std::memmove(in.data(), in.data() + head + size, have);
    return got;
}

WebSocketClient::Received WebSocketClient::receive(int timeout_us, std::string_view& text) {
    if (socket < 0) return Received::closed;
    const int64_t until = now_ns() + int64_t(timeout_us) * 1000;
    for (;;) {
        for (size_t before = 0; before != have;) { // as many frames as have come
            before = have;
            Received got = read_frame(text);
            if (got != Received::nothing) return got;
        }
        bool over = now_ns() >= until;
        size_t before = have;
        if (!fill(until)) return Received::closed;
        if (over && have == before) return Received::nothing;
    }
}

bool WebSocketClient::send_frame(uint8_t opcode, std::string_view text) {
    size_t head = 2;
    out[0] = uint8_t(0x80 | opcode);
    if (text.size() < 126)
        out[1] = uint8_t(0x80 | text.size());
    else {
        if (text.size() > 0xFFFF) return false;
        out[1] = 0x80 | 126;
        out[2] = uint8_t(text.size() >> 8);
        out[3] = uint8_t(text.size());
        head = 4;
    }
    mask ^= mask << 13, mask ^= mask >> 17, mask ^= mask << 5; // no secret: RFC 6455 masks to protect proxies
    uint8_t key[4];
    std::memcpy(key, &mask, 4);
    std::memcpy(&out[head], key, 4);
    head += 4;
    for (size_t i = 0; i < text.size(); i++) out[head + i] = uint8_t(uint8_t(text[i]) ^ key[i % 4]);
    // Some hundred bytes always fit; if they do not, the service has long stopped reading.
    return send_bytes(socket, out.data(), head + text.size());
}

bool WebSocketClient::send(std::string_view text) { return socket >= 0 && send_frame(text_frame, text); }

void WebSocketClient::close() {
    if (socket < 0) return;
    send_frame(closing, {});
    finish_sending(socket); // and read on: closing with bytes unread would throw away what we have just sent
    for (int64_t until = now_ns() + 100'000'000; now_ns() < until && wait_readable(socket, until - now_ns());) {
        const int got = receive_bytes(socket, in.data(), in.size());
        if (got == 0 || got < would_block) break;
    }
    close_socket(socket);
    socket = -1;
}

} // namespace palpate
