#include "websocket.h"
#include "clock.h"
#include "sha1.h"
#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <random>
#include <sys/socket.h>
#include <unistd.h>

#ifndef MSG_NOSIGNAL
#define MSG_NOSIGNAL 0
#endif

namespace palpate {
namespace {

constexpr uint8_t continued = 0, text_frame = 1, closing = 8, ping = 9, pong = 10;

bool ready(int socket, short what, int64_t until_ns) {
    pollfd one{socket, what, 0};
    int64_t left = std::max<int64_t>(0, until_ns - now_ns());
#ifdef __linux__ // to the microsecond: a millisecond is a whole tick
    timespec patience{time_t(left / 1000000000), long(left % 1000000000)};
    return ppoll(&one, 1, &patience, nullptr) > 0;
#else
    return ::poll(&one, 1, int(left / 1000000)) > 0;
#endif
}

} // namespace

std::string websocket_accept(const std::string& key) {
    return base64(sha1(key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"));
}

std::string WebSocket::open(const std::string& host, int port, int patience) {
    close();
    std::string why = connect_to(host, port, patience);
    if (why.empty()) why = shake_hands(host, port, patience);
    if (!why.empty()) close();
    return why;
}

std::string WebSocket::connect_to(const std::string& host, int port, int patience) {
    addrinfo hints{}, *all = nullptr;
    hints.ai_socktype = SOCK_STREAM;
    if (int bad = getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &all)) return gai_strerror(bad);
    std::string why = "no address";
    for (addrinfo* each = all; each && socket < 0; each = each->ai_next) {
        int s = ::socket(each->ai_family, each->ai_socktype, each->ai_protocol);
        if (s < 0) continue;
        fcntl(s, F_SETFL, fcntl(s, F_GETFL) | O_NONBLOCK);
        fcntl(s, F_SETFD, FD_CLOEXEC);
        int bad = ::connect(s, each->ai_addr, each->ai_addrlen) ? errno : 0;
        if (bad == EINPROGRESS) {
            socklen_t size = sizeof bad;
            if (!ready(s, POLLOUT, now_ns() + int64_t(patience) * 1000000))
                bad = ETIMEDOUT;
            else
                getsockopt(s, SOL_SOCKET, SO_ERROR, &bad, &size);
        }
        if (bad) {
            why = std::strerror(bad);
            ::close(s);
            continue;
        }
        int yes = 1;
        setsockopt(s, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
#ifdef SO_NOSIGPIPE
        setsockopt(s, SOL_SOCKET, SO_NOSIGPIPE, &yes, sizeof yes);
#endif
        socket = s;
    }
    freeaddrinfo(all);
    return socket < 0 ? why : "";
}

std::string WebSocket::shake_hands(const std::string& host, int port, int patience) {
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
    if (::send(socket, hello.data(), hello.size(), MSG_NOSIGNAL) != ssize_t(hello.size())) return "it closed the door";
    const int64_t until = now_ns() + int64_t(patience) * 1000000;
    for (;;) {
        std::string_view answer(reinterpret_cast<const char*>(in.data()), have);
        size_t end = answer.find("\r\n\r\n");
        if (end != std::string_view::npos) {
            answer = answer.substr(0, end);
            bool well =
                answer.substr(0, 12) == "HTTP/1.1 101" && answer.find(websocket_accept(key)) != std::string_view::npos;
            if (!well) return "it speaks no WebSocket";
            have -= end + 4;
            std::memmove(in.data(), in.data() + end + 4, have);
            return "";
        }
        if (have > 8192) return "it speaks no WebSocket";
        if (now_ns() >= until) return "it does not answer";
        if (!fill(until)) return "it closed the door";
    }
}

bool WebSocket::fill(int64_t until_ns) {
    if (!ready(socket, POLLIN, until_ns)) return true;
    ssize_t got = recv(socket, in.data() + have, in.size() - have, 0);
    if (got < 0) return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
    have += size_t(got);
    return got > 0;
}

// Takes one frame off the front of what has come.
WebSocket::Got WebSocket::frame(std::string_view& text) {
    if (have < 2) return Got::nothing;
    size_t head = 2, size = in[1] & 127;
    if (in[1] & 128 || in[0] & 0x70) return Got::gone; // servers do not mask; we asked for no extension
    if (size >= 126) {
        size_t digits = size == 126 ? 2 : 8;
        if (have < 2 + digits) return Got::nothing;
        size = 0;
        for (size_t i = 0; i < digits; i++) size = size << 8 | in[2 + i];
        head += digits;
    }
    if (size > most) return Got::gone;
    if (have < head + size) return Got::nothing;
    const bool last = in[0] & 128;
    const uint8_t opcode = in[0] & 15;
    const char* body = reinterpret_cast<const char*>(in.data() + head);
    Got got = Got::nothing;
    if (opcode == text_frame || opcode == continued) {
        if (opcode == text_frame) length = 0;
        if (length + size > most) return Got::gone;
        std::memcpy(message.data() + length, body, size);
        length += size;
        if (last) {
            text = {reinterpret_cast<const char*>(message.data()), length};
            got = Got::message;
        }
    } else if (opcode == ping) {
        if (size > 125 || !put(pong, {body, size})) return Got::gone;
    } else if (opcode != pong)
        return Got::gone; // it closes, or sends what we cannot read
    have -= head + size;
    std::memmove(in.data(), in.data() + head + size, have);
    return got;
}

WebSocket::Got WebSocket::receive(int patience_us, std::string_view& text) {
    if (socket < 0) return Got::gone;
    const int64_t until = now_ns() + int64_t(patience_us) * 1000;
    for (;;) {
        for (size_t before = 0; before != have;) { // as many frames as have come
            before = have;
            Got got = frame(text);
            if (got != Got::nothing) return got;
        }
        bool over = now_ns() >= until;
        size_t before = have;
        if (!fill(until)) return Got::gone;
        if (over && have == before) return Got::nothing;
    }
}

bool WebSocket::put(uint8_t opcode, std::string_view text) {
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
    mask ^= mask << 13, mask ^= mask >> 17, mask ^= mask << 5; // hides nothing; it keeps proxies from being fooled
    uint8_t key[4];
    std::memcpy(key, &mask, 4);
    std::memcpy(&out[head], key, 4);
    head += 4;
    for (size_t i = 0; i < text.size(); i++) out[head + i] = uint8_t(uint8_t(text[i]) ^ key[i % 4]);
    // Some hundred bytes always fit: if they do not, the service has not read for long and is as good as gone.
    return ::send(socket, out.data(), head + text.size(), MSG_NOSIGNAL) == ssize_t(head + text.size());
}

bool WebSocket::send(std::string_view text) { return socket >= 0 && put(text_frame, text); }

void WebSocket::close() {
    if (socket < 0) return;
    put(closing, {});
    shutdown(socket, SHUT_WR); // and read on: closing with bytes unread would throw away what we have just sent
    for (int64_t until = now_ns() + 100'000'000; now_ns() < until && ready(socket, POLLIN, until);) {
        ssize_t got = recv(socket, in.data(), in.size(), 0);
        if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR)) break;
    }
    ::close(socket);
    socket = -1;
}

} // namespace palpate
