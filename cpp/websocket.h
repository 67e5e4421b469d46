#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace palpate {

// A client for text over a WebSocket (RFC 6455) to a service on this machine. Buffers have their full size from the
// start: once open, sending and receiving allocate nothing, and a message beyond `most` ends the connection.
class WebSocket {
public:
    static constexpr size_t most = 1 << 18; // bytes a message
    enum class Got { message, nothing, gone };

    WebSocket() : in(most + 16), message(most), out(most + 16) {}
    ~WebSocket() { close(); }
    WebSocket(const WebSocket&) = delete;
    WebSocket& operator=(const WebSocket&) = delete;

    // "" if it worked, else why not. patience: ms, for each of its steps.
    std::string open(const std::string& host, int port, int patience);
    bool send(std::string_view text);                     // false: the connection is gone
    Got receive(int patience_us, std::string_view& text); // of the next message; it lasts until the next call
    void close();

private:
    int socket = -1;
    std::vector<uint8_t> in, message, out;
    size_t have = 0, length = 0; // bytes in `in`, in `message`
    uint32_t mask = 0x9e3779b9;
    bool fill(int64_t until_ns); // waits for bytes; false: gone
    Got frame(std::string_view& text);
    bool put(uint8_t opcode, std::string_view text);
    std::string connect_to(const std::string& host, int port, int patience);
    std::string shake_hands(const std::string& host, int port, int patience);
};

std::string websocket_accept(const std::string& key); // what a server must answer to `key`

} // namespace palpate
