#pragma once
// A client for text messages over a WebSocket (RFC 6455) to a service on this machine; for the Haply driver, on its
// thread. Buffers have their full size from the start: once open, it allocates nothing.
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace palpate {

class WebSocketClient {
public:
    static constexpr size_t max_message = 1 << 18; // bytes; a longer message ends the connection
    enum class Received { message, nothing, closed };

    WebSocketClient() : in(max_message + 16), message(max_message), out(max_message + 16) {}
    ~WebSocketClient() { close(); }
    WebSocketClient(const WebSocketClient&) = delete;
    WebSocketClient& operator=(const WebSocketClient&) = delete;

    // Returns "" or why it failed. timeout_ms: of each step.
    std::string open(const std::string& host, int port, int timeout_ms);
    bool send(std::string_view text);                         // false: the connection is closed
    Received receive(int timeout_us, std::string_view& text); // the text is valid until the next call
    void close();

private:
    int socket = -1;
    std::vector<uint8_t> in, message, out;
    size_t have = 0, length = 0; // bytes in `in`, in `message`
    uint32_t mask = 0x9e3779b9;
    bool fill(int64_t until_ns); // waits for bytes; false: closed
    Received read_frame(std::string_view& text);
    bool send_frame(uint8_t opcode, std::string_view text);
    std::string handshake(const std::string& host, int port, int timeout_ms);
};

std::string websocket_accept(const std::string& key); // what a server must answer to `key`

} // namespace palpate
